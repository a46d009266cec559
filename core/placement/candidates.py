"""Candidate boxes at even surface samples, facing along the normal, text upright."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from core.arrays import Float, Int
from core.geometry.boxes import Boxes
from core.geometry.products import cross
from core.geometry.sampling import thin

UP = np.array([0.0, 1.0, 0.0])
# Cosine; normals within 20 degrees of +-Y have no reading direction by the asset's up.
POLE = np.cos(np.radians(20.0))


@dataclass(frozen=True)
class CandidateOptions:
    """Values of the boxes that fitting starts from: all ours, see :data:`PAPER_CANDIDATES` for the paper's.

    Attributes:
        thickness: share of a box's longer side; room for text on curved surface.
        thinnest: size-30 units; thickness of a box, at least.
        samples: area samples drawn at once.
        draws: times that they are drawn, at most, until half as many look where text is wanted.
        radius: size-30 units between candidates; None for that which leaves ``number`` of them.
        number: boxes to fit, left after thinning: with ``samples``, about 0.5 s of fitting on one core.
        more: share of ``number`` for each share of all directions that is wanted.
        fewest: share of ``number`` however few directions are wanted.
        choice: candidates drawn for each one fitted, those with the best support: few others ever gain it.
        support_grid: rays along the text and across it that estimate the support.
        probes: directions tried for each sample; one visible from none lies inside or in a cranny.
        narrow: share of the width of legible text, or of the text if that is less; text runs along narrower strips.
        strip_density: samples in a square of twice that width a side; they decide what is a strip.
        strip_reach: radius of a strip's samples over its greatest width, so that no border of a wide face counts.
        strip: ratio of a strip's length to its width within this radius, at least.
        strip_samples: of a strip, at least.
    """

    thickness: float = 0.15
    thinnest: float = 0.25
    samples: int = 8000
    draws: int = 5
    radius: float | None = None
    number: int = 700
    more: float = 1.2
    fewest: float = 0.25
    choice: float = 2.0
    support_grid: tuple[int, int] = (8, 3)
    probes: int = 6
    narrow: float = 0.75
    strip_density: int = 300
    strip_reach: float = 1.7
    strip: float = 1.5
    strip_samples: int = 12


CANDIDATES = CandidateOptions()
# The paper's thickness of 0.5 for every text, H_s = 300 and H_r = 1, supplement "Implementation Details".
PAPER_CANDIDATES = CandidateOptions(thickness=0.0, thinnest=0.5, samples=300, radius=1.0)


def candidates(points: Float, normals: Float, size: tuple[float, float, float], radius: float) -> Boxes:
    """Boxes at area samples, thinned to be roughly equidistant (paper, section "Initialization").

    Args:
        points: (N, 3) area samples of the surface (the paper's H_s = 300), size-30 units.
        normals: (N, 3) unit normals there.
        size: width, height and thickness of each box, size-30 units.
        radius: samples closer than this to an earlier one are rejected (the paper's H_r = 1).
    """
    kept = thin(points, radius)
    normal = _mean_normals(points, normals, kept, reach=max(size[:2]) / 4)
    return Boxes(points[kept], upright(normal), np.tile(np.asarray(size, dtype=np.float64), (len(kept), 1)))


def upright(normal: Float) -> Float:
    """(B, 3, 3) right-handed rows right, up, normal for unit normals (B, 3): up leans towards the asset's +Y.

    Near the poles it is what a camera tilted from the front would show as up: -Z on top, +Z underneath.
    """
    polar = np.abs(normal[:, 1]) > POLE
    reference = np.where(polar[:, None], np.sign(normal[:, 1:2]) * np.array([0.0, 0.0, -1.0]), UP)
    up = reference - np.einsum("bi,bi->b", reference, normal)[:, None] * normal
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return np.stack([cross(up, normal), up, normal], axis=1)


def along_strips(
    boxes: Boxes, points: Float, normals: Float, narrow: float, options: CandidateOptions = CANDIDATES
) -> Boxes:
    """The same boxes; on bars, handles, shins and other strips less than ``narrow`` across text runs along the strip.

    Args:
        boxes: upright ones.
        points: (N, 3) area samples of the surface, size-30 units.
        normals: (N, 3) unit normals there; samples that face another way than the box by over 60 degrees do not
            count.
        narrow: size-30 units.
        options: tuned values.
    """
    owner, which = _alike(points, normals, boxes.center, boxes.axes[:, 2], options.strip_reach * narrow)
    local = np.einsum("ni,nki->nk", points[which] - boxes.center[owner], boxes.axes[owner, :2])
    count = np.maximum(np.bincount(owner, minlength=len(boxes)), 1)
    mean = np.stack([np.bincount(owner, column, len(boxes)) for column in local.T], axis=1) / count[:, None]
    local -= mean[owner]
    moments = np.stack(
        [np.bincount(owner, local[:, a] * local[:, b], len(boxes)) for a in (0, 1) for b in (0, 1)], axis=1
    )
    least, most, way = _spread(*(moments[:, [0, 1, 3]] / count[:, None]).T)
    # The variance of an even strip is a twelfth of its width squared.
    strip = (count >= options.strip_samples) & (12 * least < narrow**2) & (most > options.strip**2 * least)
    along = np.where(strip[:, None], way, (1.0, 0.0))
    along *= np.where(along[:, :1] < 0, -1.0, 1.0)
    right, normal = np.einsum("bk,bkj->bj", along, boxes.axes[:, :2]), boxes.axes[:, 2]
    return Boxes(boxes.center, np.stack([right, cross(normal, right), normal], axis=1), boxes.size)


def _spread(xx: Float, xy: Float, yy: Float) -> tuple[Float, Float, Float]:
    """(B,) each the least and the greatest variance of points in a plane with these moments, and (B, 2) the direction
    of the greatest."""
    half, apart = (xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    least, most = half - apart, half + apart
    wide = (xx >= yy)[:, None]
    way = np.where(wide, np.stack([most - yy, xy], axis=1), np.stack([xy, most - xx], axis=1))
    length = np.linalg.norm(way, axis=1, keepdims=True)
    return least, most, np.where(length > 0, way / np.maximum(length, np.finfo(float).tiny), (1.0, 0.0))


def right_way_up(boxes: Boxes) -> Boxes:
    """The same boxes, rotated by 180 degrees in their plane where the text would be upside down: fitting may turn one
    over an edge."""
    level = np.einsum("bi,bi->b", boxes.axes[:, 1], upright(boxes.axes[:, 2])[:, 1])
    turned = np.where(level < 0, -1.0, 1.0)
    axes = boxes.axes * np.stack([turned, turned, np.ones(len(boxes))], axis=1)[:, :, None]
    return Boxes(boxes.center, axes, boxes.size)


def _mean_normals(points: Float, normals: Float, kept: NDArray[np.int64], reach: float) -> Float:
    """Unit normals at ``points[kept]``, averaged over the area samples within ``reach`` on the same side.

    Samples are uniform by area, so a plain mean is the area-weighted one. A sharp crease or the far side of a
    thin wall must not turn the box, hence only normals within 60 degrees of the sample's own count; the sum
    of such vectors is never zero.
    """
    owner, which = _alike(points, normals, points[kept], normals[kept], reach)
    total = np.stack([np.bincount(owner, column, len(kept)) for column in normals[which].T], axis=1)
    return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))


def _alike(points: Float, normals: Float, center: Float, normal: Float, reach: float) -> tuple[Int, Int]:
    """Pairs of one of (B,) places and one of (N,) samples within ``reach`` that faces the same way within 60
    degrees: (P,), (P,)."""
    pairs = cKDTree(center).sparse_distance_matrix(cKDTree(points), reach, output_type="ndarray")
    owner, which = pairs["i"], pairs["j"]
    alike = np.einsum("ni,ni->n", normals[which], normal[owner]) > 0.5
    return owner[alike], which[alike]
