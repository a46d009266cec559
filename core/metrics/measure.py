"""Every metric of one watermarked asset: its value, what it took, or why there is none."""

import logging
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from core import models
from core.analysis.saliency import Saliency, saliency
from core.arrays import Bool, Float
from core.artwork.layouts import Layouts
from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.directions import view_directions
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.metrics.coverage import coverage
from core.metrics.crop_survival import crop_survival
from core.metrics.features import Extractor, LayoutDescriptor, extractor
from core.metrics.ipe import ipe
from core.metrics.label_height import label_height
from core.metrics.lce import lce
from core.metrics.looks import first_looks
from core.metrics.match import match
from core.metrics.measurement import Measurement, Values
from core.metrics.mesh_saliency import mesh_saliency
from core.metrics.ocr import LOOK, Look, ocr
from core.metrics.prominence import prominence
from core.metrics.ray import ray
from core.metrics.ray_origins import above_letters, top_face
from core.metrics.recognition import Reader
from core.metrics.se import se
from core.metrics.smse import smse
from core.metrics.ss import ss
from core.metrics.wps import wps
from core.metrics.wps_area import wps_area
from core.notices import Notice, NoticeCode
from core.placement.selection import visibility
from core.rendering.pictures import Drawn, Views

log = logging.getLogger(__name__)

READABILITY = ("ocr", "ocr_ge_0.8", "ocr_exact")
REMEDY = "See `match`, which compares the relief of the watermarks with their outlines, whatever the script."


@dataclass(eq=False)
class Subject:
    """One side of the comparison, with what several metrics share.

    Attributes:
        surface: in the size-30 frame of the original.
        index: over ``surface``.
        pictures: the paper's views, or why there are none; None will do for ``evaluate: geometry``.
        seed: of the samples of its saliency maps.
        mapped: its own saliency map, where that is known already.
    """

    surface: Surface
    index: SpatialIndex
    pictures: Views | MeshmarkError | None
    seed: int = 0
    mapped: Saliency | None = None

    @cached_property
    def saliency(self) -> Saliency:
        """The saliency map of ``surface``."""
        return saliency(self.surface, self.seed) if self.mapped is None else self.mapped

    @cached_property
    def published(self) -> Saliency:
        """The saliency map of ``surface`` by a published method."""
        return mesh_saliency(self.surface, self.seed)

    @property
    def views(self) -> Views:
        """The pictures, or their absence raised."""
        if isinstance(self.pictures, MeshmarkError):
            raise self.pictures
        assert self.pictures is not None
        return self.pictures


@dataclass(frozen=True, eq=False)
class Pair:
    """An asset before and after, and its marks, to be measured.

    Attributes:
        original, watermarked: in the same frame.
        boxes: the marks; may be none, and then what needs them is missing.
        relief: (B,) height of each mark's letters, size-30 units.
        text: what the marks say; empty where nobody knows, or where they have no text.
        seed: of the samples of what was measured.
        layouts: that the marks are set in; None where nobody knows.
        settings: the text in each of the ways in which the marks break it into lines; none: as it is.
    """

    original: Subject
    watermarked: Subject
    boxes: Boxes
    relief: Float
    text: str
    seed: int = 0
    layouts: Layouts | None = None
    settings: tuple[str, ...] = ()

    @cached_property
    def letters(self) -> Float:
        """(B, N, 3) points just clear of each mark's letters."""
        return above_letters(self.original.surface, self.original.index, self.boxes, self.relief)

    @cached_property
    def seen(self) -> Bool:
        """(B, 24) the paper's views that show each mark."""
        return visibility(self.boxes, self.letters, self.watermarked.index, view_directions()[0])

    def require_boxes(self) -> None:
        """Raise where there is no mark to measure."""
        if len(self.boxes) == 0:
            raise MeshmarkError(
                ErrorCode.INVALID_REQUEST,
                "Where the watermarks stand was not given.",
                "Give the watermarks as JSON, or the report of the job that made them.",
            )

    def require_layouts(self, what: str) -> Layouts:
        """The layouts; raise where nobody knows them, saying ``what`` that leaves unknown."""
        if self.layouts is None:
            raise MeshmarkError(
                ErrorCode.INVALID_REQUEST,
                f"{what} known only to the job that embosses them.",
                "See the report of that job.",
            )
        return self.layouts


def measure(
    pair: Pair,
    level: Evaluate,
    progress: Callable[[float], None] = lambda _: None,
    shared: Collection[str] = (),
) -> Measurement:
    """Measure what ``level`` asks for. Never raises: a metric that cannot be had is None, with the reason.

    Args:
        pair: what to compare.
        level: ``none`` measures nothing, ``geometry`` leaves out what looks at pictures.
        progress: called with the share done.
        shared: groups that are left out because another measurement of the same marks has them.
    """
    found = Measurement()
    asked = [group for group in _GROUPS if level is Evaluate.FULL or level is group.level]
    wanted = [group for group in asked if group.name not in shared]
    for group in _GROUPS:
        if group.name in shared:
            found.missing |= dict.fromkeys(group.metrics, _SHARED)
        elif group not in asked:
            found.missing |= dict.fromkeys(group.metrics, _not_requested(level))
    for number, group in enumerate(wanted):
        progress(number / len(wanted))
        start = time.perf_counter()
        try:
            found.values |= group.measure(pair, found)
        except MeshmarkError as error:
            found.missing |= dict.fromkeys(group.metrics, error.notice())
        except Exception as error:  # the asset is marked: what keeps it from being measured must not take it back
            log.exception("the metrics of %s could not be measured", group.name)
            found.missing |= dict.fromkeys(group.metrics, _failed(error))
        found.seconds[group.name] = round(time.perf_counter() - start, 4)
    progress(1.0)
    return found


_SHARED = Notice(
    NoticeCode.NOT_MEASURED, "It is measured on the model alone.", "See the report's `metrics`, on the same marks."
)


def _not_requested(level: Evaluate) -> Notice:
    return Notice(
        NoticeCode.NOT_REQUESTED, f"The request asked for evaluate: {level.value}.", "Ask for evaluate: full."
    )


def _failed(error: Exception) -> Notice:
    return Notice(
        ErrorCode.EVALUATION_FAILED,
        f"The measurement ended with an error ({type(error).__name__}).",
        "The model is not affected. Report it to the operator; the log holds the details.",
    )


def _placement(pair: Pair, _: Measurement) -> Values:
    pair.require_boxes()
    original, boxes = pair.original.surface, pair.boxes
    return {"wps": float(wps(original, boxes).mean()), "wps_area": float(wps_area(original, boxes).mean())}


def _visibility(pair: Pair, _: Measurement) -> Values:
    pair.require_boxes()
    boxes, index = pair.boxes, pair.watermarked.index
    return {
        "ray": ray(boxes, pair.letters, index),
        "ray_box": ray(boxes, top_face(boxes), index),
        "coverage": coverage(boxes, pair.letters, index),
        "crop_survival": crop_survival(pair.original.surface, boxes),
    }


def _prominence(pair: Pair, _: Measurement) -> Values:
    pair.require_boxes()
    after = pair.watermarked
    shares = prominence(pair.original.index, after.surface, after.index, pair.boxes, pair.relief)
    return dict(zip(("prominence", "prominence_least"), shares, strict=True))


def _label_height(pair: Pair, _: Measurement) -> Values:
    pair.require_boxes()
    layouts = pair.require_layouts("How high the letters of the watermarks are is")
    original, boxes = pair.original, pair.boxes
    height, radius = layouts.line_height(boxes.size), original.surface.radius
    return {"label_height_share": label_height(boxes, height, pair.letters, pair.watermarked.index, radius)}


def _artwork(pair: Pair, _: Measurement) -> Values:
    pair.require_boxes()
    layouts = pair.require_layouts("The outlines of the watermarks are")
    return {"match": float(match(pair.boxes, pair.relief, layouts, pair.watermarked.index).mean())}


def _shape(pair: Pair, _: Measurement) -> Values:
    rng = np.random.default_rng(pair.seed)
    distance, squared = smse(pair.original.index, pair.watermarked.surface, rng)
    return {
        "smse": distance,
        "smse_squared": squared,
        "ipe": ipe(pair.original.surface, pair.watermarked.surface),
    }


def _curvature(pair: Pair, _: Measurement) -> Values:
    pair.require_boxes()
    variance = lce(pair.original.index, pair.watermarked.surface, pair.boxes, pair.relief)
    if variance is None:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "No vertex of the watermarked asset lies on top of a letter in any of the given places.",
            "Check that places, relief and both files use the same coordinates.",
        )
    return dict(zip(("lce", "lce_pooled"), variance, strict=True))


def _saliency(pair: Pair, found: Measurement) -> Values:
    pair.require_boxes()
    share, found.box_saliency = se(pair.original.saliency, pair.boxes)
    published, _ = se(pair.original.published, pair.boxes)
    return {"se": share, "se_lee2005": published}


def _readability(pair: Pair, found: Measurement) -> Values:
    if not pair.text and pair.layouts is None:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST, "What the watermarks say was not given.", "Give the text of the watermarks."
        )
    if reason := _unreadable(pair.text):
        found.missing |= dict.fromkeys(READABILITY, reason)
        return {}
    pictures, looks = pair.watermarked.views.large, dict[int, Look]()
    if isinstance(pictures, Drawn) and len(pair.boxes):
        places, right = first_looks(pair.boxes, pair.seen, pictures.frame)
        looks = {view: Look(part, right[view]) for view, part in pictures.parts(places, LOOK).items()}
    read = ocr(pictures, pair.settings or (pair.text,), _reader(), looks)
    found.read = read.per_view
    return dict(zip(READABILITY, (read.ratio, read.ge_08, read.exact), strict=True))


def _unreadable(text: str) -> Notice | None:
    """The reason why no text recognition can tell whether watermarks read well, if there is one."""
    if not text:
        return Notice(NoticeCode.NO_TEXT, "The watermarks have no text that could be read.", REMEDY)
    if not (unknown := _reader().unknown(text)):
        return None
    listed = ", ".join(f"{one} (U+{ord(one):04X})" for one in unknown[:5])
    return Notice(
        NoticeCode.UNREADABLE_SCRIPT,
        f"The text recognition does not know {listed}{' and others' if len(unknown) > 5 else ''}; it reads Latin, "
        "Greek without accents, Chinese and Japanese.",
        REMEDY,
    )


def _semantics(pair: Pair, found: Measurement) -> Values:
    before, after = pair.original.views, pair.watermarked.views
    features = _extractor()
    score = ss(before.compared, after.compared, features)
    found.semantics = features.name
    if isinstance(features, LayoutDescriptor) and (unused := models.unreadable(models.RESNET50.name)):
        found.warnings.append(unused)
    return {"ss": score}


@dataclass(frozen=True)
class _Group:
    """Metrics that come from the same work."""

    name: str
    metrics: tuple[str, ...]
    level: Evaluate
    measure: Callable[[Pair, Measurement], Values]


_GROUPS = (
    _Group("placement", ("wps", "wps_area"), Evaluate.GEOMETRY, _placement),
    _Group("visibility", ("ray", "ray_box", "coverage", "crop_survival"), Evaluate.GEOMETRY, _visibility),
    _Group("prominence", ("prominence", "prominence_least"), Evaluate.GEOMETRY, _prominence),
    _Group("label height", ("label_height_share",), Evaluate.GEOMETRY, _label_height),
    _Group("artwork", ("match",), Evaluate.GEOMETRY, _artwork),
    _Group("shape", ("smse", "smse_squared", "ipe"), Evaluate.GEOMETRY, _shape),
    _Group("curvature", ("lce", "lce_pooled"), Evaluate.GEOMETRY, _curvature),
    _Group("saliency", ("se", "se_lee2005"), Evaluate.GEOMETRY, _saliency),
    _Group("readability", READABILITY, Evaluate.FULL, _readability),
    _Group("semantics", ("ss",), Evaluate.FULL, _semantics),
)


@cache
def _reader() -> Reader:
    return Reader()


@cache
def _extractor() -> Extractor:
    return extractor()
