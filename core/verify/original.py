"""A suspect file against the original of a job: whether the marks that were reported stand on it."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import ValidationError

from core.arrays import Bool, Float, Int
from core.artwork.layouts import Layouts
from core.artwork.lettering import layouts_of
from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.evaluate import parse_watermarks, to_boxes
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.geometry.products import product
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.surface import Surface
from core.gltf.scene import flatten
from core.metrics.match import MatchOptions, match
from core.report import FileFacts, Place, Report
from core.reporting import file_facts
from core.verify.heights import height_field, height_picture, standing_out, tallest
from core.verify.look import Picture
from core.verify.marks import FoundMark
from core.verify.registration import Registration, Similarity, registrations
from core.verify.report import ComparedMark, Comparison

MOST_MARKS = 256  # of a report
# What the best alignment of the same model leaves at most, over the suspect's radius, and covers of it at least.
RESIDUAL, COVERED = 0.007, 0.1
# Likeness of the relief to the artwork from which on a mark is there; without artwork, the share of its box that stands
# out; and the share of its box, below which there is not enough surface to say.
LIKE, OUT, SURFACE = 0.35, 0.3, 0.5
MATCH = MatchOptions(rays=4096)
Field = tuple[Float, Bool]  # as :func:`core.verify.heights.height_field` gives
# Of a line that was read: width and height over its own, and the thickness over its height.
ROUND = np.array([1.2, 1.6, 1.0])


@dataclass(frozen=True)
class Against:
    """Files that a suspect is compared with.

    Attributes:
        original: the asset without marks, in any accepted format.
        report: ``meshmark.report/1`` of a job that marked it, JSON; None where there is none.
    """

    original: bytes
    report: bytes | None = None


@dataclass(frozen=True, eq=False)
class Reference:
    """An original that was read, and the report of a job.

    Attributes:
        file: the original.
        surface: of it.
        index: over that.
        report: of the job; None without one.
        boxes: the reported marks, in the frame of ``surface``.
        relief: (B,) height of their letters, size-30 units.
        layouts: that they are set in; None where these are not known.
    """

    file: FileFacts
    surface: Surface
    index: SpatialIndex
    report: Report | None
    boxes: Boxes
    relief: Float
    layouts: Layouts | None

    @property
    def texts(self) -> tuple[str, ...]:
        """The texts of the reported marks."""
        marks = self.report.watermarks if self.report else []
        return tuple(dict.fromkeys(mark.text for mark in marks if mark.text))


@dataclass(frozen=True, eq=False)
class Aligned:
    """A suspect in the frame of an original.

    Attributes:
        registration: of it.
        index: over the suspect, in its own frame.
    """

    registration: Registration
    index: SpatialIndex

    def first_hit(self, origins: Float, directions: Float, eye: Eye | None = None) -> tuple[Float, Int]:
        """First hit of each ray in the original's frame, see :meth:`SpatialIndex.first_hit`."""
        similarity = self.registration.similarity
        turned = product(directions, similarity.rotation)
        distance, face = self.index.first_hit(similarity.inverse()(origins), turned, eye)
        return distance * similarity.scale, face


def read_reference(against: Against, budgets: Budgets) -> Reference:
    """The original, read.

    Raises:
        MeshmarkError: as the loaders; ``invalid_parameters`` for a report that is none.
    """
    report, marks = None, list[Place]()
    if against.report is not None:
        report, marks = _read_report(against.report), parse_watermarks(against.report)
    admitted = admit(against.original, budgets)
    surface = flatten(document_of(admitted, budgets)).surface
    boxes, relief = to_boxes(marks, surface)
    return Reference(
        file=file_facts(against.original, admitted.format),
        surface=surface,
        index=SpatialIndex(surface.positions, surface.faces),
        report=report,
        boxes=boxes,
        relief=relief,
        layouts=None if report is None else _layouts(report),
    )


def _read_report(data: bytes) -> Report:
    try:
        report = Report.model_validate_json(data, extra="ignore")
    except ValidationError as error:
        first = error.errors()[0]
        problem = f"{'.'.join(map(str, first['loc'])) or 'all of it'}: {first['msg']}"
    else:
        if len(report.watermarks) <= MOST_MARKS:
            return report
        problem = f"it has {len(report.watermarks):,} watermarks; at most {MOST_MARKS} are compared"
    raise MeshmarkError(
        ErrorCode.INVALID_PARAMETERS,
        f"The report of the job is not valid: {problem}.",
        "Give the report (meshmark.report/1) as it came with the result.",
    )


def _layouts(report: Report) -> Layouts | None:
    """The layouts of a job's marks; None where a logo or a font was sent, which a report does not hold."""
    if any(mark.logo == "svg" for mark in report.watermarks):
        return None
    try:
        layouts = layouts_of(report.parameters)
    except MeshmarkError:  # the text needs fonts that are not installed here
        return None
    used = {face.name for artwork in layouts.artworks for face in artwork.faces}
    return layouts if {font.name for font in report.fonts} <= used else None


def align(suspect: Surface, reference: Reference) -> Aligned:
    """The suspect in the frame of the original; of alignments that are as good, the one that shows most of the marks.

    Raises:
        MeshmarkError: ``different_model``.
    """
    found = registrations(suspect, reference.surface)
    fitting = [one for one in found if one.residual <= RESIDUAL and one.covered >= COVERED]
    if not fitting:
        best = found[0]
        raise MeshmarkError(
            ErrorCode.DIFFERENT_MODEL,
            f"These are not the same model: the best fit leaves a residual of {100 * best.residual:.2g} % of the "
            f"model's radius (the same model: at most {100 * RESIDUAL:g} %) and covers {100 * best.covered:.2g} % of "
            "the original.",
            "Give the original that the suspect file was made from, or verify without one.",
        )
    index = SpatialIndex(suspect.positions, suspect.faces)
    aligned = [Aligned(one, index) for one in fitting]
    if len(fitting) == 1 or not len(reference.boxes):
        return aligned[0]
    return max(aligned, key=lambda one: _shown(one, reference))


def _shown(aligned: Aligned, reference: Reference) -> float:
    """Likeness of all reported marks together, or what stands out of them where their artwork is not known."""
    likeness = _likeness(aligned, reference)
    if likeness is not None:
        return float(sum(likeness))
    fields = [height_field(box, aligned, reference.index) for box in _each(reference.boxes)]
    return sum(standing_out(*field, relief) for field, relief in zip(fields, reference.relief.tolist(), strict=True))


def _likeness(aligned: Aligned, reference: Reference) -> list[float] | None:
    if reference.layouts is None:
        return None
    boxes, relief = reference.boxes, reference.relief
    found = match(boxes, relief, reference.layouts, aligned, MATCH, ground=reference.index)
    return [float(one) for one in found]


def _each(boxes: Boxes) -> list[Boxes]:
    return [boxes[number : number + 1] for number in range(len(boxes))]


def compare(
    suspect: Surface, data: bytes, aligned: Aligned, reference: Reference, read: Sequence[FoundMark]
) -> tuple[Comparison, list[Picture]]:
    """The section of the report about the original, and a picture of the relief of each of its marks: those of the
    job's report, or without one those that were ``read``.

    Args:
        suspect: in its own size-30 frame.
        data: its file.
        aligned: the same, in the original's.
        reference: the original.
        read: marks that were read on the suspect, in its own frame.
    """
    report, similarity = reference.report, aligned.registration.similarity
    boxes = reference.boxes if report else _boxes_of(read, similarity)
    fields = [height_field(box, aligned, reference.index) for box in _each(boxes)]
    if report:
        marks = _reported(report, reference, fields, _likeness(aligned, reference))
    else:
        texts = [mark.known or mark.text for mark in read]
        marks = [
            _compared(number, text, field, reference.surface)
            for number, (text, field) in enumerate(zip(texts, fields, strict=True))
        ]
    world = _in_world(similarity, suspect, reference.surface)
    section = Comparison(
        file=reference.file,
        is_asset=report.asset.sha256 == reference.file.sha256 if report else None,
        is_result=report.model.sha256 == hashlib.sha256(data).hexdigest() if report else None,
        scale=world.scale,
        rotation=world.rotation.tolist(),
        translation=world.translation.tolist(),
        residual=round(aligned.registration.residual, 6),
        covered=round(aligned.registration.covered, 4),
        marks=marks,
    )
    return section, [height_picture(*field) for field in fields]


def _compared(index: int, text: str, field: Field, original: Surface) -> ComparedMark:
    """The relief of a mark over an original."""
    return ComparedMark(
        index=index,
        text=text,
        surface=round(float(field[1].mean()), 4),
        height=float(f"{tallest(*field) / original.scale:.4g}"),
    )


def _reported(
    report: Report, reference: Reference, fields: list[Field], likeness: list[float] | None
) -> list[ComparedMark]:
    """The marks of a job's report, with the answer whether each is there."""
    found = []
    for number, (mark, field) in enumerate(zip(report.watermarks, fields, strict=True)):
        known = None if likeness is None else round(likeness[number], 4)
        out = standing_out(*field, float(reference.relief[number]))
        one = _compared(mark.id, mark.text, field, reference.surface)
        present = known >= LIKE if known is not None else out >= OUT
        found.append(
            one.model_copy(
                update={
                    "present": present if one.surface >= SURFACE else None,
                    "correlation": known,
                    "standing_out": round(out, 4),
                }
            )
        )
    return found


def _boxes_of(read: Sequence[FoundMark], similarity: Similarity) -> Boxes:
    """Boxes round lines that were read, in the original's frame."""
    if not read:
        return Boxes.empty()
    center = similarity(np.array([mark.spot.center for mark in read]))
    axes = np.array([[mark.spot.right, mark.spot.up, mark.spot.normal] for mark in read])
    size = np.array([[mark.spot.length, mark.spot.height, mark.spot.height] for mark in read])
    return Boxes(center, axes @ similarity.rotation.T, ROUND * similarity.scale * size)


def _in_world(similarity: Similarity, suspect: Surface, original: Surface) -> Similarity:
    """The same map between world coordinates."""
    scale = similarity.scale * suspect.scale / original.scale
    origin = original.to_world(similarity(np.zeros((1, 3))))[0]
    return Similarity(scale, similarity.rotation, origin - scale * similarity.rotation @ suspect.offset)
