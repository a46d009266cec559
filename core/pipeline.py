"""The one way of an asset through the engine, readable from top to bottom.

Stages that need torch and the geometry libraries import them when they start: these take more than a second and a
quarter of a gigabyte to load, which a file that cannot be read shall not cost. A process that runs the engine again and
again calls :func:`preload` first.
"""

import json
import logging
import resource
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from core.artwork.outline import Lettering, lettering
from core.budgets import DEFAULT_BUDGETS, Budgets
from core.embossing.mesh import WorkingMesh
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.sniff import Format
from core.gltf.document import Document
from core.gltf.prune import unreferenced_bytes
from core.gltf.scene import Scene, flatten
from core.gltf.textures import undecoded_textures
from core.gltf.validate import is_beside
from core.gltf.write import write
from core.notices import Notice, NoticeCode
from core.parameters import Evaluate, Parameters
from core.preload import preload as preload
from core.rendering.pictures import PICTURE_SIZE, pictures
from core.rendering.preview import contact_sheet
from core.rendering.renderer import Renderer

if TYPE_CHECKING:
    from core.analysis.analyse import SurfaceAnalysis
    from core.analysis.saliency import Saliency
    from core.embossing.copies import MarkedCopy
    from core.embossing.emboss import Mark
    from core.geometry.spatial import SpatialIndex
    from core.placement.context import PlacementContext
    from core.placement.objective import Objective, Placement

log = logging.getLogger(__name__)

Progress = Callable[[str, float], None]
Publish = Callable[[str, bytes], None]


@dataclass
class Job:
    """What the stages hand on; each field is set by the one stage named after it."""

    data: bytes
    parameters: Parameters
    font: bytes | None
    budgets: Budgets
    preview_wanted: bool
    report_progress: Callable[[float], None]
    publish: Publish
    objective: "Objective | None" = None
    timings: dict[str, float] = field(default_factory=dict)
    memory: dict[str, int] = field(default_factory=dict)
    warnings: list[Notice] = field(default_factory=list)
    # read
    format: Format = field(init=False)
    scene: Scene = field(init=False)
    ground: "SurfaceAnalysis" = field(init=False)
    # letter
    lettering: Lettering = field(init=False)
    # place
    usable: NDArray[np.bool_] = field(init=False)  # (F,) faces a watermark may be cut into
    saliency: "Saliency" = field(init=False)
    rng: np.random.Generator = field(init=False)  # of placement
    context: "PlacementContext" = field(init=False)
    placement: "Placement" = field(init=False)
    opaque: float = field(init=False)  # share of a face that is opaque, for letters to stand on it
    # emboss
    mesh: WorkingMesh = field(init=False)
    marks: "dict[int, Mark]" = field(init=False)  # by the number of the box in `placement`
    refusals: Counter[str] = field(init=False)
    # write
    colors: list[str | None] = field(init=False)  # of the letters of each mark, "#rrggbb"; None: their ground's own
    model: bytes = field(init=False)
    copies: "list[MarkedCopy]" = field(init=False)
    written: Scene = field(init=False)  # read back from the model
    # report
    report: dict[str, Any] = field(init=False)
    # render
    preview: bytes | None = None
    # the paper's views before and after, or why there are none
    views: tuple[NDArray[np.uint8], NDArray[np.uint8]] | MeshmarkError | None = None


@dataclass(frozen=True)
class Result:
    """What a watermarking run gives back.

    Attributes:
        model: the watermarked GLB.
        report: ``meshmark.report/1``; ``service/docs/report.md`` has its fields.
        preview: a PNG contact sheet; None where none was asked for, or where none could be rendered (then the
            report's ``warnings`` say why).
    """

    model: bytes
    report: dict[str, Any]
    preview: bytes | None


def _read(job: Job) -> None:
    admitted = admit(job.data, job.budgets)
    document, job.format = document_of(admitted, job.budgets), admitted.format
    job.scene = flatten(document)
    job.warnings += document.warnings
    if unreferenced := unreferenced_bytes(document):
        job.warnings.append(
            Notice(
                NoticeCode.UNREFERENCED_DATA,
                f"Nothing in this file refers to {unreferenced:,} bytes of it; they are not in the result, "
                "where they could be a copy without watermarks.",
                "Nothing needs to be done; exporting the asset anew leaves such bytes out.",
            )
        )
    beside = [image["uri"] for image in document.json.get("images", []) if is_beside(image)]
    if beside:
        job.warnings.append(
            Notice(
                ErrorCode.EXTERNAL_REFERENCE,
                f"The asset's textures lie in other files ({', '.join(beside[:3])}); they were not opened. "
                "Where marks stand, and what pictures and figures show, is reckoned without them.",
                "Keep these files beside the result, or embed them before the upload.",
            )
        )

    from core.analysis.analyse import analyse

    job.ground = analyse(job.scene)


def _letter(job: Job) -> None:
    job.lettering = lettering(job.parameters.text, job.font)


def _place(job: Job) -> None:
    from core.analysis.analyse import HIDING
    from core.analysis.facts import Carrier, SurfaceFacts
    from core.analysis.opacity import opacity
    from core.analysis.regions import regions
    from core.analysis.saliency import saliency
    from core.analysis.skinning import skin_deformation
    from core.analysis.texture import texture_saliency
    from core.placement.context import build_context
    from core.placement.objective import OBJECTIVE
    from core.placement.place import place

    ground, parameters = job.ground, job.parameters
    asked = regions(job.scene, ground.surface, parameters)
    job.rng = np.random.default_rng(parameters.seed)
    job.saliency = saliency(ground.surface, parameters.seed)
    samples = job.saliency.points, job.saliency.face
    texture, skin = (
        texture_saliency(job.scene, ground.surface, *samples),
        skin_deformation(job.scene, ground.surface, *samples),
    )
    job.warnings += undecoded_textures(job.scene.document)

    def on(usable: NDArray[np.bool_], index: "SpatialIndex", opaque: float) -> "Placement":
        job.usable, job.opaque = asked.within(usable), opaque
        carrier = Carrier(
            ground.surface,
            index,
            job.usable,
            ground.component,
            opacity(job.scene, ground.surface, job.usable) if opaque else None,
        )
        facts = SurfaceFacts(job.saliency, texture, skin, asked)
        job.context = build_context(carrier, facts, job.lettering, parameters, job.rng, job.objective or OBJECTIVE)
        return place(job.context, job.rng, job.report_progress)

    try:
        job.placement = on(ground.opaque, ground.index, HIDING)
    except MeshmarkError as error:
        if error.code is not ErrorCode.NO_PLACEMENT or (ground.cuttable == ground.opaque).all():
            raise
        job.placement = on(ground.cuttable, ground.glazed, 0.0)
        job.warnings.append(
            Notice(
                NoticeCode.SEE_THROUGH_SURFACE,
                "Nothing opaque has room for the text; it stands on what is seen through, where it may be hard to see.",
                "Make the materials opaque, or use a shorter text.",
            )
        )


def _emboss(job: Job) -> None:
    from core.embossing.islands import letter_islands
    from core.embossing.marks import emboss_marks
    from core.placement.legibility import legible_height

    job.mesh = WorkingMesh(job.ground.surface, job.usable, job.ground.coincident, job.ground.resolution)
    done = emboss_marks(
        job.mesh, job.context, job.placement, letter_islands(job.lettering), job.rng, job.report_progress
    )
    job.placement, job.marks, job.refusals = done.placement, done.marks, done.refusals
    highest = max(mark.box.size[0, 1] for mark in job.marks.values())
    if highest < legible_height(job.parameters.color) * (1 - 1e-6):
        sized = job.parameters.size is not None
        job.warnings.append(
            Notice(
                NoticeCode.SMALL_TEXT,
                f"No text on this asset reads well: the highest is {highest:.2g} high where the asset's "
                "largest side is 30, and is legible only from close up."
                + ("" if sized else " Nothing higher has room."),
                "Ask for a larger `size`, or use a shorter text." if sized else "Use a shorter text.",
            )
        )


def _peak_memory() -> int:
    """The most resident bytes this process has held since it began; getrusage counts in KiB except on macOS."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _write(job: Job) -> None:
    """The model, checked: marks that no viewer would draw are taken out, and it is written again without them."""
    from core.embossing.copies import unmarked
    from core.embossing.drawn import drawn_marks
    from core.embossing.unmarked import unmarked_parts

    _write_marks(job)
    ground = job.ground
    while True:
        edit, count = job.mesh.edit(), len(job.marks)
        drawn = drawn_marks(edit, count, ground.surface, ground.resolution, job.written, job.opaque)
        if drawn.all():
            break
        _take_out(job, [box for box, seen in zip(job.marks, drawn.tolist(), strict=True) if not seen])
        _write_marks(job)
    job.warnings += unmarked(job.copies)
    marked = ground.surface.face_primitive[edit.source_face[np.unique(edit.mark, return_index=True)[1]]]
    without = unmarked_parts(job.scene, ground.surface, job.saliency, job.context.carrier.index, marked)
    job.warnings += [without] if without else []
    job.publish("model", job.model)


def _take_out(job: Job, undrawn: list[int]) -> None:
    """Embosses the marks anew, without those in the boxes ``undrawn``.

    Raises:
        MeshmarkError: ``no_placement`` where none is left.
    """
    from core.embossing.emboss import Mark
    from core.embossing.islands import letter_islands
    from core.embossing.marks import emboss_boxes
    from core.embossing.refusal import Refusal
    from core.report import boxes_of

    kept = {box: mark for box, mark in job.marks.items() if box not in undrawn}
    job.refusals[Refusal.UNDRAWN.value] += len(undrawn)
    job.mesh = WorkingMesh(job.ground.surface, job.usable, job.ground.coincident, job.ground.resolution)
    job.marks = {}
    if kept:
        boxes, _ = boxes_of(kept, job.parameters)
        outcomes = emboss_boxes(
            job.mesh, boxes, letter_islands(job.lettering), job.parameters, job.context.carrier.index
        )
        for box, outcome in zip(kept, outcomes, strict=True):
            if isinstance(outcome, Mark):
                job.marks[box] = outcome
            else:
                job.refusals[outcome.value] += 1
    if not job.marks:
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"All {job.refusals.total()} marks that fit on this asset would be culled, clear or covered by its own "
            "materials: no viewer would draw them.",
            "Check which sides of the asset its materials show, and their alpha.",
        )


def _write_marks(job: Job) -> None:
    from core.analysis.contrast import letter_colors
    from core.embossing.copies import AssetMarks, mark_copies
    from core.embossing.islands import letter_islands
    from core.report import boxes_of

    boxes, _ = boxes_of(job.marks, job.parameters)
    worn = letter_colors(job.scene, job.ground.surface, job.context.carrier.index, boxes, job.parameters.color)
    job.colors = [color.color if color else None for color in worn]
    glowing = {number for number, color in enumerate(worn) if color and color.glows}
    job.model = write(job.scene, job.ground.with_file_winding(job.mesh.edit()), job.colors, glowing)
    marks = AssetMarks(job.ground.surface, boxes, letter_islands(job.lettering), job.colors, glowing, job.parameters)
    job.model, job.copies = mark_copies(job.model, marks)
    job.written = flatten(Document.from_glb(job.model))


def _report(job: Job) -> None:
    """The report without its metrics, published at once: whatever happens from here on, the job has one."""
    from core.report import build_report

    measured = job.parameters.evaluate is not Evaluate.NONE
    job.report = build_report(
        data=job.data,
        file_format=job.format,
        parameters=job.parameters,
        surface=job.scene.surface,
        model=job.model,
        written=job.written.surface.in_frame_of(job.scene.surface) if measured else None,
        placement=job.placement,
        marks=job.marks,
        colors=job.colors,
        copies=job.copies,
        refusals=job.refusals,
        timings=job.timings,
        memory=job.memory,
        warnings=job.warnings,
    )
    job.publish("report", json.dumps(job.report, allow_nan=False).encode())


def _render(job: Job) -> None:
    """The preview and the pictures that metrics look at, from one OpenGL context."""
    measured = job.parameters.evaluate is Evaluate.FULL
    if not measured and not job.preview_wanted:
        return
    try:
        with Renderer(PICTURE_SIZE) as renderer:
            if measured:
                before = pictures(job.scene.document.to_glb(), renderer)
                job.views = before, pictures(job.model, renderer, frame=renderer.frame)
            else:
                renderer.load(job.model)
            if job.preview_wanted:
                job.preview = contact_sheet(renderer)
                job.publish("preview", job.preview)
    except MeshmarkError as error:
        job.views = error
    except Exception as error:  # drivers fail in ways of their own
        log.exception("the pictures of this asset could not be drawn")
        job.views = MeshmarkError(
            ErrorCode.RENDERING_UNAVAILABLE,
            f"The pictures of this asset could not be drawn ({type(error).__name__}).",
            "The model is not affected. Report it to the operator; the log holds the details.",
        )
    if isinstance(job.views, MeshmarkError):
        # The asset is marked; a machine that cannot render still delivers it, and says so.
        job.warnings.append(job.views.notice())


def _evaluate(job: Job) -> None:
    if job.parameters.evaluate is Evaluate.NONE:
        return
    from core.analysis.analyse import eye_index
    from core.metrics.measure import Pair, Subject, measure
    from core.report import boxes_of, with_metrics

    before, after = job.views if isinstance(job.views, tuple) else (job.views, job.views)
    # Measured on the file as it was written, rounding included.
    written, index = eye_index(job.written, job.scene.surface, through=job.opaque > 0)
    pair = Pair(
        Subject(job.ground.surface, job.context.carrier.index, before, job.parameters.seed, job.saliency),
        Subject(written, index, after),
        *boxes_of(job.marks, job.parameters),
        job.parameters.text,
        job.parameters.seed,
    )
    measured = measure(pair, job.parameters.evaluate, job.report_progress)
    job.warnings += measured.warnings
    job.report = with_metrics(job.report, measured)


# Name, the stage, and its share of the progress bar.
STAGES: list[tuple[str, Callable[[Job], None], float]] = [
    ("reading", _read, 0.05),
    ("lettering", _letter, 0.02),
    ("placing", _place, 0.25),
    ("embossing", _emboss, 0.13),
    ("writing", _write, 0.03),
    ("reporting", _report, 0.02),
    ("rendering", _render, 0.2),
    ("evaluating", _evaluate, 0.3),
]


def watermark(
    data: bytes,
    parameters: Parameters,
    *,
    font: bytes | None = None,
    budgets: Budgets = DEFAULT_BUDGETS,
    preview: bool = True,
    progress: Progress | None = None,
    publish: Publish | None = None,
    objective: "Objective | None" = None,
) -> Result:
    """Embosses a watermark into a mesh file.

    Args:
        data: the content of a file; it decides what the file is, not a name.
        parameters: what is asked for.
        font: a TrueType or OpenType file; None for the bundled one.
        budgets: what the asset may declare before it is read.
        preview: whether to render a contact sheet.
        progress: called with the stage's name and the share done of the whole run, 0 to 1.
        publish: called with "model", "report" and "preview" and their bytes as soon as each exists, before the run
            ends. The report is the one that stands should the run not end: its metrics are missing still.
        objective: the weights of placement, for ablations; None for those of the product.

    Returns:
        The GLB, the report and the preview. The same arguments on the same device give the same GLB bytes.

    Raises:
        MeshmarkError: for everything that keeps the asset from being watermarked; nothing was published then.
    """
    done = 0.0

    def report_progress(share: float) -> None:
        if progress is not None:
            progress(name, done + weight * min(share, 1.0))

    publish = publish or (lambda _name, _bytes: None)
    job = Job(data, parameters.resolved(), font, budgets, preview, report_progress, publish, objective)
    for name, stage, weight in STAGES:
        report_progress(0.0)
        start = time.perf_counter()
        stage(job)
        job.timings[name] = round(time.perf_counter() - start, 4)
        job.memory[name] = _peak_memory()
        done += weight
    job.report["warnings"] = [asdict(warning) for warning in job.warnings]
    return Result(job.model, job.report, job.preview)
