"""Segments in the plane: those that cross others, and distances to them."""

import numpy as np

from core.arrays import Bool, Float
from core.geometry.bounds import meeting
from core.geometry.products import dot
from core.geometry.triangles import doubled_area


def crossing(segments: Float, edges: Float) -> Bool:
    """(S,) those of the ``segments`` (S, 2, 2) that cross any of the ``edges`` (E, 2, 2) between their ends."""
    result = np.zeros(len(segments), dtype=bool)
    for segment, edge in meeting(*_boxes(segments), *_boxes(edges)):
        (a, b), (c, d) = segments[segment].transpose(1, 0, 2), edges[edge].transpose(1, 0, 2)
        crossed = doubled_area(a, b, c) * doubled_area(a, b, d) < 0
        crossed &= doubled_area(c, d, a) * doubled_area(c, d, b) < 0
        result[segment[crossed]] = True
    return result


def distance_to_edges(points: Float, edges: Float, within: float, toward: Float | None = None) -> Float:
    """(N,) distances of (N, 2) ``points`` to the nearest of the segments (E, 2, 2), inf where none is near.

    Args:
        points: in the plane.
        edges: start and end of each segment.
        within: distance up to which segments count.
        toward: (N, 2) if given, set to the nearest points where there are some.
    """
    best = np.full(len(points), np.inf)
    along = edges[:, 1] - edges[:, 0]
    squared = np.maximum(dot(along, along), np.finfo(float).tiny)
    low, high = _boxes(edges)
    for point, edge in meeting(points, points, low - within, high + within):
        way, away = along[edge], points[point] - edges[edge, 0]
        away -= np.clip(dot(away, way) / squared[edge], 0.0, 1.0)[:, None] * way
        square = dot(away, away)
        least = best.copy()
        np.minimum.at(least, point, square)
        if toward is not None:
            # Of equally near ones the first, which is assigned last.
            nearest = np.flatnonzero((square == least[point]) & (square < best[point]))[::-1]
            toward[point[nearest]] = points[point[nearest]] - away[nearest]
        best = least
    distance = np.sqrt(best)
    return np.where(distance <= within, distance, np.inf)


def _boxes(segments: Float) -> tuple[Float, Float]:
    """(S, 2) lowest and highest coordinates of ``segments`` (S, 2, 2)."""
    start, end = segments[:, 0], segments[:, 1]
    return np.minimum(start, end), np.maximum(start, end)
