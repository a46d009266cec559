"""The report, ``meshmark.report/1``: what was done, where, and what it cost the asset."""

import hashlib
from collections import Counter
from typing import Any

import numpy as np

from core import __version__
from core.asset.sniff import Format
from core.asset.surface import MODEL_SIZE, Surface
from core.embossing.emboss import Mark
from core.metrics.report import asset_facts, geometry_metrics
from core.metrics.wps_area import wps_area
from core.parameters import Parameters
from core.placement.boxes import Boxes
from core.placement.selection import Placement
from core.rendering.views import view_directions
from core.spatial import SpatialIndex

SCHEMA = "meshmark.report/1"

Warnings = list[dict[str, str]]


def build_report(
    *,
    data: bytes,
    file_format: Format,
    parameters: Parameters,
    surface: Surface,
    index: SpatialIndex,
    model: bytes,
    written: Surface | None,
    placement: Placement,
    marks: dict[int, Mark],
    refusals: Counter[str],
    timings: dict[str, float],
    memory: dict[str, int],
    warnings: Warnings,
) -> dict[str, Any]:
    """The report as a JSON-ready mapping.

    Args:
        data: the uploaded file.
        file_format: its format.
        parameters: resolved.
        surface: of the asset, with its ``index``.
        model: the GLB that was written.
        written: the surface read back from ``model``, in the asset's size-30 frame; None skips the metrics.
        placement: the candidates that survived.
        marks: the watermarks by number of their box in ``placement``.
        refusals: how many boxes embossing refused, by reason.
        timings: seconds by stage; kept by reference, so that stages that end later still appear.
        memory: the most resident bytes the process had held up to the end of each stage; by reference likewise.
        warnings: what did not go as asked; kept by reference likewise.
    """
    boxes = Boxes(
        np.concatenate([mark.box.center for mark in marks.values()]),
        np.concatenate([mark.box.axes for mark in marks.values()]),
        np.concatenate([mark.box.size for mark in marks.values()]),
    )
    score = wps_area(surface, boxes)
    view_count = len(view_directions()[0])
    relief = np.abs([parameters.relief_at(width) for width in boxes.size[:, 0]])
    watermarks = [
        {
            "id": number,
            "text": parameters.text,
            "center": surface.to_world(boxes.center[number]).tolist(),
            "right": boxes.axes[number, 0].tolist(),
            "up": boxes.axes[number, 1].tolist(),
            "normal": boxes.axes[number, 2].tolist(),
            "size": (boxes.size[number] / surface.scale).tolist(),
            "relief": float(relief[number] / surface.scale),
            "loss": float(placement.loss[box]),
            "roughness": float(placement.roughness[box]),
            "saliency": None,
            "placement_score": float(score[number]),
            "views": int(placement.visible[box, :view_count].sum()),
            "cut": mark.cut,
        }
        for number, (box, mark) in enumerate(marks.items())
    ]
    metrics = None
    if written is not None:
        written_index = SpatialIndex(written.positions, written.faces)
        metrics = geometry_metrics(surface, index, written, written_index, boxes, relief, seed=parameters.seed)
    return {
        "schema": SCHEMA,
        "asset": {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data), "format": file_format.value}
        | asset_facts(surface),
        "model": {"sha256": hashlib.sha256(model).hexdigest(), "bytes": len(model), "format": Format.GLB.value}
        | (asset_facts(written) if written is not None else {}),
        "parameters": parameters.model_dump(mode="json"),
        "seed": parameters.seed,
        "engine": {"version": __version__, "device": "cpu"},
        "units": {"model_size": MODEL_SIZE, "scale": surface.scale, "offset": surface.offset.tolist()},
        "watermarks": watermarks,
        "embossing": {
            "tried": len(marks) + sum(refusals.values()),
            "verified": len(marks),
            "refused": dict(sorted(refusals.items())),
        },
        "metrics": metrics,
        "warnings": warnings,
        "timings": timings,
        "memory": memory,
    }
