"""Letter tops at a constant distance from the surface (paper section 4.4, curve-matching embossing)."""

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.products import cross, product
from core.geometry.spatial import Eye, SpatialIndex

FIT_ROUNDS = 2  # rounds: the variance of the distance is then near 1e-14
MIN_AGREEMENT = 0.3  # cosine; a smooth normal further away from the box normal than this is not used
SAME_GROUND = 0.5  # cosine between a letter's normal and that of the surface its height is measured from
FOLD_TOLERANCE = 1e-4  # share of the letters' area that may face away after lifting: slivers of rounding errors


def lift(base: Float, normals: Float, relief: float, index: SpatialIndex) -> Float:
    """(N, 3) cap vertices above the points ``base`` (N, 3): ``relief`` along the unit ``normals`` (N, 3), then moved so
    that their distance to the surface is ``|relief|`` exactly. A negative relief sinks. Size-30 frame.

    Distances count only to surface of about the letters' normal: not to a step beside them, the back of a wall, or a
    shell around the asset that is drawn from within only.
    """
    tops = base + relief * normals
    for _ in range(FIT_ROUNDS):
        distance, face, nearest = index.closest(tops)
        stands_on = np.einsum("ni,ni->n", index.normals(face), normals) > SAME_GROUND
        away = stands_on & (distance > abs(relief) * 1e-3)
        direction = (tops - nearest) / np.where(away, distance, 1.0)[:, None]
        step = np.where(away, np.clip(abs(relief) - distance, -abs(relief) / 2, abs(relief) / 2), 0.0)
        tops = tops + step[:, None] * direction
    return tops


def folded(tops: Float, triangles: Int, normal: Float) -> bool:
    """True where lifted letter ``triangles`` (L, 3) into ``tops`` face away from the box ``normal`` (3,)."""
    area = _facing(tops, triangles, normal)
    return bool(-area[area < 0].sum() > FOLD_TOLERANCE * np.abs(area).sum())


def inverted(tops: Float, triangles: Int, normal: Float) -> Bool:
    """(L,) those of the ``triangles`` (L, 3) into ``tops`` that face away from the box ``normal`` (3,)."""
    return _facing(tops, triangles, normal) < 0


def _facing(tops: Float, triangles: Int, normal: Float) -> Float:
    """(L,) twice the areas seen along ``normal``."""
    a, b, c = (tops[triangles[:, k]] for k in range(3))
    return np.asarray(product(cross(b - a, c - a), normal[:, None])[:, 0])


def obstructed(base: Float, tops: Float, relief: float, index: SpatialIndex) -> Bool:
    """(N,) true where other surface is within one and a half reliefs of the letters: above raised ones, behind sunken.

    ``base`` (N, 3) are points of the surface, ``tops`` (N, 3) those of the letters above them.
    """
    direction = tops - base
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), np.finfo(float).tiny)
    reach = 1.5 * abs(relief)
    if relief > 0:
        # The first hit of a ray back from above must be the letter's own base.
        distance, _ = index.first_hit(base + reach * direction, -direction, Eye.ORIGIN)
        return np.asarray(distance < 0.95 * reach)
    # Likewise from below, where another side of a wall, however thin it is, is met from its front.
    distance, face = index.first_hit(base + reach * direction, -direction)
    slack = 0.05 * abs(relief)
    from_front = (face >= 0) & (np.einsum("ni,ni->n", index.normals(face), direction) > 0)
    return np.asarray((distance < reach - slack) | (from_front & (distance < reach + slack)))
