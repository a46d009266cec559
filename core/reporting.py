"""Building the report from what the stages found."""

import hashlib
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from core import __version__
from core.arrays import Float
from core.choices import Evaluate
from core.device import device
from core.embossing.emboss import Mark
from core.embossing.refusal import Refusal
from core.geometry.boxes import Boxes
from core.geometry.directions import EYE_DISTANCE, field_of_view, view_directions
from core.geometry.surface import MODEL_SIZE, Surface
from core.metrics.measurement import HIGHER_IS_BETTER, UNITS, Measurement
from core.metrics.topology import topology
from core.metrics.wps_area import wps_area
from core.notices import Notice, NoticeCode
from core.parameters import Parameters
from core.report import (
    AssetFacts,
    AssetUtility,
    CopyFacts,
    Embossing,
    Engine,
    ExportFacts,
    Eye,
    FileFacts,
    Frame,
    LabelFacts,
    Metrics,
    PreviewModelFacts,
    Report,
    ViewFacts,
    Watermark,
    WatermarkQuality,
)
from core.stages import Asset, Embossed, Exported, LightOutput, Output


def build_report(asset: Asset, output: Output, parameters: Parameters, light: LightOutput | None = None) -> Report:
    """The report of what was written, its metrics still missing and without an account of the run.

    Args:
        asset: that was read.
        output: the GLB, its marks, and the other copies of the asset in it.
        parameters: resolved.
        light: the preview model, if there is one.
    """
    surface, embossed = asset.scene.surface, output.embossed
    measured = parameters.evaluate is not Evaluate.NONE
    model = file_facts(output.file.data, output.file.format)
    refusals = Counter(embossed.refusals.values()) if embossed else Counter[Refusal]()
    refused = dict(sorted(refusals.items()))
    verified = len(embossed.marks) if embossed else 0
    return Report(
        asset=asset_facts(file_facts(asset.data, asset.format), surface),
        model=asset_facts(model, output.scene.surface.in_frame_of(surface)) if measured else model,
        export=_export(output.exported),
        parameters=parameters,
        seed=parameters.seed,
        engine=Engine(version=__version__, device=device().value),
        units=frame_of(surface),
        eye=eye_of(surface),
        watermarks=_watermarks(surface, embossed, output, parameters) if embossed else [],
        copies=[
            CopyFacts(kind=item.copy.kind, name=item.copy.name, watermarks=item.watermarks, outcome=item.outcome)
            for item in output.copies
        ],
        embossing=Embossing(tried=verified + sum(refused.values()), verified=verified, refused=refused),
        label=_label(output, parameters),
        preview_model=None if light is None else _preview_model(light, output, parameters),
        metrics=metrics_of(_unmeasured()) if measured else None,
        fonts=[],
        warnings=[],
        timings={},
        memory={},
    )


def _export(exported: Exported | None) -> ExportFacts | None:
    if exported is None:
        return None
    file = file_facts(exported.file.data, exported.file.format)
    more = {"unit": exported.unit, "up": exported.up, "left_out": list(exported.left_out)}
    return ExportFacts.model_validate(file.model_dump() | more)


def _label(output: Output, parameters: Parameters) -> LabelFacts | None:
    label, heights, rule = output.label, output.heights, parameters.rule
    if label is None:
        return None
    return LabelFacts(
        packet=label.packet,
        source_type=label.source_type,
        aigc=label.aigc,
        height_reached=None if heights is None or rule is None else float((heights >= rule).mean()),
        kept=list(label.kept),
    )


def _preview_model(light: LightOutput, output: Output, parameters: Parameters) -> PreviewModelFacts:
    assert parameters.preview_model is not None
    assert output.embossed is not None
    assert light.output.embossed is not None
    file, alone = light.output.file, parameters.preview_model.alone
    facts = file_facts(file.data, file.format)
    carried = light.output.embossed.marks.keys()
    refused = Counter(light.lacking.values())
    return PreviewModelFacts(
        sha256=facts.sha256,
        bytes=facts.bytes,
        format=facts.format,
        alone=alone,
        triangles_before=light.before,
        triangles=light.triangles,
        faces=len(light.output.scene.surface.faces),
        textures=light.textures,
        watermarks=[number for number, box in enumerate(output.embossed.marks) if box in carried],
        refused=dict(sorted(refused.items())),
        seconds=light.seconds,
        metrics=None if alone or parameters.evaluate is Evaluate.NONE else metrics_of(_unmeasured()),
    )


def with_metrics(report: Report, measured: Measurement) -> Report:
    """The report with its metrics, and the saliency under each mark."""
    saliency = measured.box_saliency
    watermarks = [
        mark.model_copy(update={"saliency": None if saliency is None else float(saliency[number])})
        for number, mark in enumerate(report.watermarks)
    ]
    return report.model_copy(update={"watermarks": watermarks, "metrics": metrics_of(measured)})


def with_own_metrics(report: Report, measured: Measurement) -> Report:
    """The report with the metrics of its preview model."""
    assert report.preview_model is not None
    own = report.preview_model.model_copy(update={"metrics": metrics_of(measured)})
    return report.model_copy(update={"preview_model": own})


def boxes_of(marks: dict[int, Mark]) -> tuple[Boxes, NDArray[np.float64]]:
    """The bounds (B) of all marks in their order, and the height (B,) of their letters, size-30 units."""
    boxes = Boxes.concat(*(mark.bounds for mark in marks.values()))
    return boxes, np.abs([mark.relief for mark in marks.values()])


def file_facts(data: bytes, file_format: str) -> FileFacts:
    """Content and format of a file."""
    return FileFacts(sha256=hashlib.sha256(data).hexdigest(), bytes=len(data), format=str(file_format))


def asset_facts(file: FileFacts, surface: Surface) -> AssetFacts:
    """A file with size and topology of its surface: counts, and whether it is closed."""
    found = topology(surface)
    return AssetFacts(
        sha256=file.sha256,
        bytes=file.bytes,
        format=file.format,
        vertices=len(surface.positions),
        faces=len(surface.faces),
        components=found.components,
        watertight=found.watertight,
        boundary_edges=found.boundary_edges,
        nonmanifold_edges=found.nonmanifold_edges,
    )


def frame_of(surface: Surface) -> Frame:
    """The size-30 frame of a surface."""
    x, y, z = surface.offset.tolist()
    return Frame(model_size=MODEL_SIZE, scale=surface.scale, offset=(x, y, z))


def eye_of(surface: Surface) -> Eye:
    """The cameras round a surface: its middle is theirs, and its farthest point is in their pictures."""
    return Eye(distance=EYE_DISTANCE, fov=round(float(np.degrees(field_of_view(surface.radius))), 2))


def metrics_of(measured: Measurement) -> Metrics:
    """All metrics of a measurement, and why some are missing."""
    values = {kind: {name: measured.values[name] for name in names} for kind, names in HIGHER_IS_BETTER.items()}
    return Metrics(
        watermark_quality=WatermarkQuality.model_validate(values["watermark_quality"]),
        asset_utility=AssetUtility.model_validate(values["asset_utility"]),
        higher_is_better={name: better for names in HIGHER_IS_BETTER.values() for name, better in names.items()},
        units=UNITS,
        semantics=measured.semantics or None,
        views=None if measured.read is None else _views(measured.read),
        missing=measured.missing,
        seconds=measured.seconds,
    )


def _views(read: Float) -> list[ViewFacts]:
    """The paper's views, in which the text was ``read`` (24,) so far."""
    directions, ups = (np.round(each, 6) + 0.0 for each in view_directions())
    return [
        ViewFacts(direction=direction, up=up, ocr=round(ratio, 4))
        for direction, up, ratio in zip(directions.tolist(), ups.tolist(), read.tolist(), strict=True)
    ]


def _watermarks(surface: Surface, embossed: Embossed, output: Output, parameters: Parameters) -> list[Watermark]:
    marks, placement = embossed.marks, embossed.placement
    boxes, relief = boxes_of(marks)
    layouts = embossed.letters.layouts
    layout = layouts.of(boxes.size)
    score = wps_area(surface, boxes)
    view_count = len(view_directions()[0])
    return [
        Watermark(
            id=number,
            text=parameters.text,
            lines=list(layouts.artworks[layout[number]].lines),
            logo=layouts.artworks[layout[number]].logo,
            center=surface.to_world(boxes.center[number]).tolist(),
            right=boxes.axes[number, 0].tolist(),
            up=boxes.axes[number, 1].tolist(),
            normal=boxes.axes[number, 2].tolist(),
            size=(boxes.size[number] / surface.scale).tolist(),
            color=mark.look.style.color,
            contrast=mark.look.contrast,
            colored_by=None if coloring is None else coloring.colored_by,
            color_error=None if coloring is None else coloring.error,
            relief=float(relief[number] / surface.scale),
            loss=float(placement.loss[box]),
            roughness=float(placement.roughness[box]),
            saliency=None,
            placement_score=float(score[number]),
            views=int(placement.visible[box, :view_count].sum()),
            cut=mark.cut,
            drawn=True,
        )
        for number, ((box, mark), coloring) in enumerate(zip(marks.items(), output.coloring, strict=True))
    ]


def _unmeasured() -> Measurement:
    """The metrics of a report whose measurement has not ended."""
    measurement = Measurement()
    reason = Notice(
        NoticeCode.NOT_MEASURED,
        "The process ended before it had measured the result.",
        "The model is not affected. Ask for evaluate: geometry if it happens again.",
    )
    measurement.missing |= dict.fromkeys(measurement.values, reason)
    return measurement
