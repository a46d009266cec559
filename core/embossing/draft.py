"""The draft of moulded and minted letters: caps are a little smaller than bases, so that walls are inclined.

Seen head-on, a vertical wall has no area, and a cap is shaded as the surface around it. An inclined wall faces the
light on one side of a stroke and away from it on the other, so that letters have a bright and a dark contour.
"""

from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection, triangulate
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.geometry.spatial import SpatialIndex
from core.geometry.triangles import doubled_area

SLIVER = 1e-8  # square text widths; smaller triangles are not tested


@dataclass(frozen=True)
class DraftOptions:
    """Values of :func:`draft`: all ours; the paper's walls are vertical.

    Attributes:
        inset: of the caps, in mean stroke widths. OCR of uncoloured letters in the paper's views, mean of five assets:
            0.64 upright, 0.72 at 0.2, 0.73 at 0.25 and 0.3, 0.72 at 0.4; of eight assets: 0.69 upright, 0.79 at 0.25.
        mitre: insets that a corner moves at most: a sharp one would run far along its bisector.
        letter_room: share of their area that triangles of the letters keep under the draft.
        cut_room: the same of triangles that are cut from a surface.
        ease_apex: factor of the shift at the corner opposite a failing triangle's longest side.
        ease: factor of the shift at its other corners.
        rounds: of easing, at most.
    """

    inset: float = 0.25
    mitre: float = 2.0
    letter_room: float = 0.1
    cut_room: float = 0.05
    ease_apex: float = 0.7
    ease: float = 0.9
    rounds: int = 120


DRAFT = DraftOptions()


@dataclass(frozen=True, eq=False)
class Draft:
    """Inward shift of the points of letters, linear over each triangle of the letters; in text widths.

    Attributes:
        shift: (N, 2) of the outlines' points.
        triangles: (K, 3) of the letters, counter-clockwise.
        index: of these triangles in the plane z = 0.
        options: tuned values.
    """

    shift: Float
    triangles: Int
    index: SpatialIndex
    options: DraftOptions = DRAFT

    def of(self, points: Float, triangles: Int) -> Float:
        """(T, 2) shift of the corners ``points`` (T, 2) of ``triangles`` (L, 3) that were cut from a surface along the
        outlines. No triangle is inverted. Points on one side of an outline stay collinear and in order, and strokes
        are compressed evenly between their two sides."""
        _, face, nearest = self.index.closest(np.column_stack([points, np.zeros(len(points))]))
        corners = self.triangles[face]
        a, b, c = (self.index.positions[corners[:, k], :2] for k in range(3))
        point = nearest[:, :2]
        area = np.stack([doubled_area(b, c, point), doubled_area(c, a, point), doubled_area(a, b, point)], axis=1)
        shift = np.einsum("tk,tkj->tj", area / area.sum(axis=1, keepdims=True), self.shift[corners])
        return _eased(points, shift, triangles, self.options.cut_room, self.options)


def draft(islands: tuple[CrossSection, ...], options: DraftOptions = DRAFT) -> Draft:
    """The draft of letters (text widths): everywhere the same inset, less where they are too thin for it."""
    rings = [np.ascontiguousarray(ring) for island in islands for ring in island.to_polygons()]
    points = np.concatenate(rings)
    triangles = np.asarray(triangulate(rings), dtype=np.int64)
    triangles = triangles[doubled_area(*_corners(points, triangles)) > 0]
    perimeter = sum(float(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum()) for ring in rings)
    stroke = 2 * sum(island.area() for island in islands) / perimeter  # of a long one, exactly its width
    inwards = options.inset * stroke * np.concatenate([_mitres(ring, options.mitre) for ring in rings])
    shift = _eased(points, inwards, triangles, options.letter_room, options)
    return Draft(shift, triangles, SpatialIndex(np.column_stack([points, np.zeros(len(points))]), triangles), options)


def _mitres(ring: Float, most: float) -> Float:
    """(N, 2) shift of the corners of a ``ring`` (N, 2), the letter on its left, when its sides move inwards by 1:
    ``most`` at most."""
    along = np.roll(ring, -1, axis=0) - ring
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    after = np.column_stack([-along[:, 1], along[:, 0]])
    bisector = after + np.roll(after, 1, axis=0)
    length = np.maximum(np.linalg.norm(bisector, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.asarray(bisector / length * np.minimum(2 / length, most))


def _eased(points: Float, shift: Float, triangles: Int, room: float, options: DraftOptions) -> Float:
    """``shift`` (T, 2) of ``points`` (T, 2), shortened where one of the ``triangles`` (L, 3) would keep less than
    ``room`` of its area under any part of it; zero where that does not help."""
    a, b, c = _corners(points, triangles)
    opposite = np.stack([np.sum((c - b) ** 2, axis=1), np.sum((a - c) ** 2, axis=1), np.sum((b - a) ** 2, axis=1)])
    apex = np.take_along_axis(triangles, opposite.argmax(axis=0)[:, None], axis=1)[:, 0]
    share = np.ones(len(points))
    near = np.arange(len(triangles))
    for _ in range(options.rounds):
        tight = near[_is_tight(points, share[:, None] * shift, triangles[near], room)]
        if not len(tight):
            return share[:, None] * shift
        factor = np.ones(len(points))
        factor[triangles[tight]] = options.ease
        factor[apex[tight]] = options.ease_apex
        share *= factor
        near = np.flatnonzero((factor < 1)[triangles].any(axis=1))
    return np.zeros_like(shift)


def _is_tight(points: Float, shift: Float, triangles: Int, room: float) -> NDArray[np.bool_]:
    """(L,) triangles that keep less than ``room`` of their area while their corners move by any part of ``shift``.

    The area is quadratic in that part: it is least at an end or at the vertex of the parabola.
    """
    start = doubled_area(*_corners(points, triangles))
    end = doubled_area(*_corners(points + shift, triangles))
    bend = doubled_area(*_corners(shift, triangles))
    slope = end - start - bend
    turn = np.clip(np.divide(-slope, 2 * bend, out=np.zeros_like(bend), where=bend > 0), 0.0, 1.0)
    least = np.minimum(end, start + turn * (slope + turn * bend))
    return np.asarray(least < room * start - 2 * SLIVER)


def _corners(points: Float, triangles: Int) -> tuple[Float, Float, Float]:
    return points[triangles[:, 0]], points[triangles[:, 1]], points[triangles[:, 2]]
