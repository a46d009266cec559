"""Rings of an artwork: shapes united, kept clear of each other, and normalised to width 1."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, JoinType

from core.arrays import Float
from core.geometry.triangles import ring_area

Segments = Sequence[tuple[str, tuple[tuple[float, float], ...]]]

# Shares of the artwork's width. Rings come no closer to each other or to themselves than CLEARANCE: rings that touch
# would be cut into a surface as a non-manifold seam.
CLEARANCE = 1e-4
MERGE_DISTANCE = 2e-5
MIN_AREA = 1e-7


def flatten(segments: Segments, tolerance: float) -> list[Float]:
    """Pen segments as closed polygons, (N, 2) each, whose chords stay within ``tolerance`` of the curves."""
    contours: list[Float] = []
    pieces: list[Float] = []
    for kind, points in segments:
        if kind == "moveTo":
            pieces = [np.array(points, dtype=np.float64)]
        elif kind == "closePath":
            contours.append(np.concatenate(pieces))
        else:
            pieces.append(_curve(np.vstack([pieces[-1][-1:], points]), tolerance))
    return [contour for contour in contours if len(contour) >= 3]


def _curve(control: Float, tolerance: float) -> Float:
    """Points of a Bezier curve of degree 1 to 3 after its start.

    Chords over equal parameter steps h lie within max|B''| h^2 / 8 of the curve, and |B''| is at most
    n (n - 1) times the largest second difference of the n + 1 control points.
    """
    degree = len(control) - 1
    bend = np.linalg.norm(np.diff(control, n=2, axis=0), axis=1).max(initial=0) if degree > 1 else 0
    steps = max(1, int(np.ceil(np.sqrt(degree * (degree - 1) * bend / (8 * tolerance)))))
    t = np.arange(1, steps + 1)[:, None] / steps
    layers = [np.broadcast_to(point, (steps, 2)) for point in control]
    while len(layers) > 1:  # de Casteljau
        layers = [(1 - t) * a + t * b for a, b in pairwise(layers)]
    return np.array(layers[0])


def clear_rings(union: CrossSection) -> list[Float]:
    """Simple, disjoint rings of shapes that are about 1 wide, none closer to another than CLEARANCE."""
    union = union.simplify(MERGE_DISTANCE)
    reach = [union.offset(sign * CLEARANCE / 2, JoinType.Miter) for sign in (-1, 1)]
    if any(_topology(section) != _topology(union) for section in reach):
        # Rings touch or nearly do: a morphological opening cuts hairline necks and widens hairline gaps.
        union = union.offset(-CLEARANCE, JoinType.Miter).offset(CLEARANCE / 2, JoinType.Miter)
        union = union.simplify(MERGE_DISTANCE)
    return [ring for ring in union.to_polygons() if abs(ring_area(ring)) >= MIN_AREA]


def _topology(section: CrossSection) -> tuple[int, int]:
    areas = [ring_area(ring) for ring in section.to_polygons()]
    return sum(area > MIN_AREA for area in areas), sum(area < -MIN_AREA for area in areas)


def normalised(rings: Sequence[Float]) -> tuple[tuple[Float, ...], float, float]:
    """Rings with their bounding box 1 wide and centred at the origin, its aspect, and the share that they cover."""
    points = np.concatenate(rings)
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = high - low
    centred = tuple((ring - (low + high) / 2) / width for ring in rings)
    return centred, float(height / width), sum(map(ring_area, rings)) / float(width * height)
