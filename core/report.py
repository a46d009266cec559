"""The report, ``meshmark.report/1``: what was done, where, and what it cost the asset."""

import hashlib
from collections import Counter
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core import __version__
from core.device import device
from core.embossing.copies import MarkedCopy
from core.embossing.emboss import Mark
from core.formats.sniff import Format
from core.geometry.boxes import Boxes
from core.geometry.directions import view_directions
from core.geometry.surface import MODEL_SIZE, Surface
from core.metrics.measure import Measurement
from core.metrics.topology import topology
from core.metrics.wps_area import wps_area
from core.notices import Notice, NoticeCode
from core.parameters import Evaluate, Parameters
from core.placement.objective import Placement

SCHEMA = "meshmark.report/1"


def build_report(
    *,
    data: bytes,
    file_format: Format,
    parameters: Parameters,
    surface: Surface,
    model: bytes,
    written: Surface | None,
    placement: Placement,
    marks: dict[int, Mark],
    colors: list[str | None],
    copies: list[MarkedCopy],
    refusals: Counter[str],
    timings: dict[str, float],
    memory: dict[str, int],
    warnings: list[Notice],
) -> dict[str, Any]:
    """The report as a JSON-ready mapping, its metrics still missing.

    Args:
        data: the uploaded file.
        file_format: its format.
        parameters: resolved.
        surface: of the asset.
        model: the GLB that was written.
        written: the surface read back from ``model``, in the asset's size-30 frame; None: nothing is measured.
        placement: the candidates that survived.
        marks: the watermarks by number of their box in ``placement``.
        colors: "#rrggbb" of the letters of each, in the same order; None where they have their ground's material.
        copies: what became of the file's other scenes, levels of detail and unused meshes.
        refusals: how many boxes embossing refused, by reason.
        timings: seconds by stage; kept by reference, so that stages that end later still appear.
        memory: the most resident bytes the process had held up to the end of each stage; by reference likewise.
        warnings: what did not go as asked so far.
    """
    boxes, relief = boxes_of(marks, parameters)
    score = wps_area(surface, boxes)
    view_count = len(view_directions()[0])
    watermarks = [
        {
            "id": number,
            "text": parameters.text,
            "center": surface.to_world(boxes.center[number]).tolist(),
            "right": boxes.axes[number, 0].tolist(),
            "up": boxes.axes[number, 1].tolist(),
            "normal": boxes.axes[number, 2].tolist(),
            "size": (boxes.size[number] / surface.scale).tolist(),
            "color": colors[number],
            "relief": float(relief[number] / surface.scale),
            "loss": float(placement.loss[box]),
            "roughness": float(placement.roughness[box]),
            "saliency": None,
            "placement_score": float(score[number]),
            "views": int(placement.visible[box, :view_count].sum()),
            "cut": mark.cut,
            "drawn": True,
        }
        for number, (box, mark) in enumerate(marks.items())
    ]
    return {
        "schema": SCHEMA,
        "asset": file_facts(data, file_format) | asset_facts(surface),
        "model": file_facts(model, Format.GLB) | (asset_facts(written) if written is not None else {}),
        "parameters": parameters.model_dump(mode="json"),
        "seed": parameters.seed,
        "engine": {"version": __version__, "device": device().value},
        "units": {"model_size": MODEL_SIZE, "scale": surface.scale, "offset": surface.offset.tolist()},
        "watermarks": watermarks,
        "copies": [
            {"kind": item.copy.kind, "name": item.copy.name, "watermarks": item.watermarks, "outcome": item.outcome}
            for item in copies
        ],
        "embossing": {
            "tried": len(marks) + sum(refusals.values()),
            "verified": len(marks),
            "refused": dict(sorted(refusals.items())),
        },
        "metrics": _unmeasured().report() if parameters.evaluate is not Evaluate.NONE else None,
        "warnings": [asdict(warning) for warning in warnings],
        "timings": timings,
        "memory": memory,
    }


def with_metrics(report: dict[str, Any], measured: Measurement) -> dict[str, Any]:
    """The report with its metrics, and the saliency under each mark."""
    saliency = measured.box_saliency
    watermarks = [
        mark | {"saliency": None if saliency is None else float(saliency[number])}
        for number, mark in enumerate(report["watermarks"])
    ]
    return report | {"watermarks": watermarks, "metrics": measured.report()}


def boxes_of(marks: dict[int, Mark], parameters: Parameters) -> tuple[Boxes, NDArray[np.float64]]:
    """The boxes (B) of all marks in their order, and the height (B,) of their letters, size-30 units."""
    boxes = Boxes(
        np.concatenate([mark.box.center for mark in marks.values()]),
        np.concatenate([mark.box.axes for mark in marks.values()]),
        np.concatenate([mark.box.size for mark in marks.values()]),
    )
    return boxes, np.abs([parameters.relief_at(height) for height in boxes.size[:, 1]])


def file_facts(data: bytes, file_format: Format) -> dict[str, Any]:
    """What file it was."""
    return {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data), "format": file_format.value}


def asset_facts(surface: Surface) -> dict[str, Any]:
    """Size and topology of a surface: counts, and whether it is closed."""
    found = topology(surface)
    return {
        "vertices": len(surface.positions),
        "faces": len(surface.faces),
        "components": found.components,
        "watertight": found.watertight,
        "boundary_edges": found.boundary_edges,
        "nonmanifold_edges": found.nonmanifold_edges,
    }


def _unmeasured() -> Measurement:
    """What stands in the report until the measurement has ended."""
    measurement = Measurement()
    reason = Notice(
        NoticeCode.NOT_MEASURED,
        "The process ended before it had measured the result.",
        "The model is not affected. Ask for evaluate: geometry if it happens again.",
    )
    measurement.missing |= dict.fromkeys(measurement.values, reason)
    return measurement
