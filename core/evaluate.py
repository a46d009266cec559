"""Metrics of any pair of files, independent of the tool that marked them."""

import json
import time
from contextlib import ExitStack
from typing import Any

import numpy as np
from pydantic import ValidationError

from core import __version__
from core.analysis.analyse import eye_index
from core.arrays import Float
from core.budgets import DEFAULT_BUDGETS, Budgets
from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.geometry.triangles import unit
from core.gltf.scene import Scene, flatten
from core.metrics.measure import Pair, Subject, measure
from core.rendering.pictures import PICTURE_SIZE, Views, views
from core.rendering.renderer import Renderer
from core.report import Engine, EvaluationReport, Place, Places
from core.reporting import asset_facts, eye_of, file_facts, frame_of, metrics_of


def parse_watermarks(data: bytes) -> list[Place]:
    """Watermarks from JSON: a list of them, or an object (such as a report) that has them under ``watermarks``.

    Raises:
        MeshmarkError: ``invalid_parameters``, naming each field and its error.
    """
    try:
        content = json.loads(data)
        found = Places.model_validate({"watermarks": content} if isinstance(content, list) else content).watermarks
    except ValidationError as error:
        problems = "; ".join(f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.errors()[:5])
    except ValueError as error:
        problems = str(error)
    else:
        flat = [n for n, mark in enumerate(found) if not np.linalg.norm(np.cross(mark.up, mark.normal)) > 0]
        thin = [n for n, mark in enumerate(found) if not min(mark.size) > 0]
        if not flat and not thin:
            return found
        problems = f"watermarks.{(flat or thin)[0]}: " + (
            "`up` and `normal` are parallel or zero" if flat else "`size` must be positive"
        )
    raise MeshmarkError(
        ErrorCode.INVALID_PARAMETERS,
        f"The watermarks are not valid: {problems}.",
        "Give a list of objects with center, up, normal, size and relief in the original's coordinates, or a report.",
    )


def to_boxes(watermarks: list[Place], surface: Surface) -> tuple[Boxes, Float]:
    """World watermarks as boxes (B) and heights of letters (B,) in the size-30 frame of ``surface``."""
    if not watermarks:
        return Boxes.empty(), np.empty(0)
    normal = unit(np.array([mark.normal for mark in watermarks], dtype=np.float64))
    right = unit(np.cross([mark.up for mark in watermarks], normal))
    axes = np.stack([right, np.cross(normal, right), normal], axis=1)
    world = Boxes(np.array([mark.center for mark in watermarks]), axes, np.array([mark.size for mark in watermarks]))
    return world.to_frame(surface.offset, surface.scale), np.abs([mark.relief * surface.scale for mark in watermarks])


def evaluate(
    original: bytes,
    watermarked: bytes,
    watermarks: list[Place],
    text: str = "",
    level: Evaluate = Evaluate.FULL,
    seed: int = 0,
    budgets: Budgets = DEFAULT_BUDGETS,
) -> dict[str, Any]:
    """A report (``meshmark.report/1``) on a watermarked asset: facts of both files and the metrics.

    Args:
        original, watermarked: files of any accepted format, in the same coordinates.
        watermarks: the marks; with none, the metrics that need them are missing from the report, with the reason.
        text: of the marks; if empty, that of the first of ``watermarks``.
        level: of the metrics.
        seed: of the random samples.
        budgets: bounds the files' declarations.

    Raises:
        MeshmarkError: as reading; a metric that cannot be measured is null instead, with the reason beside it.
    """
    start = time.perf_counter()
    first_file, second_file = admit(original, budgets), admit(watermarked, budgets)
    before, after = document_of(first_file, budgets), document_of(second_file, budgets)
    first, second = flatten(before), flatten(after)
    surface = first.surface
    shown, written, frame = eye_index(first, surface), eye_index(second, surface), second.surface.in_frame_of(surface)
    boxes, relief = to_boxes(watermarks, surface)
    text = text or next((mark.text for mark in watermarks if mark.text), "")
    settings = tuple(dict.fromkeys("\n".join(mark.lines) for mark in watermarks if mark.text == text and mark.lines))
    with ExitStack() as drawing:
        seen = _views(first, second, drawing) if level is Evaluate.FULL else (None, None)
        pair = Pair(
            Subject(*shown, seen[0], seed),
            Subject(*written, seen[1]),
            boxes,
            relief,
            text,
            seed,
            settings=settings,
        )
        measured = measure(pair, level)
    report = EvaluationReport(
        asset=asset_facts(file_facts(original, first_file.format), surface),
        model=asset_facts(file_facts(watermarked, second_file.format), frame),
        seed=seed,
        engine=Engine(version=__version__, device=shown[1].device),
        units=frame_of(surface),
        eye=eye_of(surface),
        watermarks=watermarks,
        warnings=measured.warnings,
        metrics=metrics_of(measured),
        timings={"evaluating": round(time.perf_counter() - start, 4)},
    )
    return report.model_dump(mode="json")


def _views(
    before: Scene, after: Scene, drawing: ExitStack
) -> tuple[Views, Views] | tuple[MeshmarkError, MeshmarkError]:
    """Pictures of both, by a renderer that is open until the end of ``drawing``; or why there are none."""
    try:
        renderer = drawing.enter_context(Renderer(PICTURE_SIZE))
        return views(before, renderer), views(after, renderer, renderer.frame)
    except MeshmarkError as error:
        return error, error
