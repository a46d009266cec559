"""Which faces that are seen from both sides are wound inside out: neighbours are made to agree, then each part is
looked at from outside. What is seen from its front only has no other side to turn."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.directions import fibonacci_directions
from core.geometry.products import product
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.surface import Surface
from core.geometry.winding import consistent

PARTS, SAMPLES, DIRECTIONS = 1024, 16, 24  # parts asked, the largest first; points on each; rays from each point
GRAZING = 0.1  # cosine under which a ray tells nothing about a side
CLEAR = 1e-3  # where rays start off the surface, size-30 units
# A part is inside out when its back is seen from outside this many times as often as its front. Both sides of an
# open sheet are seen about equally: its winding is the file's to say.
CLEARLY = 4


@dataclass(frozen=True, eq=False)
class Orientation:
    """Which sides of a surface are out.

    Attributes:
        flipped: (F,) faces whose winding must be turned for their normals to look out.
        component: (F,) number of the part that each face belongs to, -1 where it does not count.
        closed: (F,) faces of parts that have an inside, and show their fronts outside of it.
    """

    flipped: Bool
    component: Int
    closed: Bool


def orient(
    surface: Surface, distinct: Bool, one_sided: Bool, clear: Bool, index: SpatialIndex, glazed: SpatialIndex
) -> Orientation:
    """The :class:`Orientation` of a surface.

    Parts are faces connected through edges of exactly two. Within a part the winding of most of its area is right,
    and whoever disagrees with it is turned; then the part as a whole is turned if rays leave the asset from its
    back rather than from its front. A one-sided (Moebius) part stays as it is. Faces that are drawn from their front
    only are never turned: the rest of their part follows most of them, and where two of them disagree there is no
    part that both belong to.

    Args:
        surface: the asset.
        distinct: (F,) the faces that count (``sheets.distinct``); the others are never turned.
        one_sided: (F,) the faces that are drawn from their front only.
        clear: (F,) the faces that are see-through.
        index: over the asset, for which these hide nothing.
        glazed: the same, for which they do; see-through parts are judged by it.
    """
    ids = np.flatnonzero(distinct)
    first, second, agree = surface.edges.among(distinct).pairs()
    number = np.cumsum(distinct) - 1
    one, two = number[first // 3], number[second // 3]
    fixed = one_sided[ids]
    together = agree | ~fixed[one] | ~fixed[two]
    one, two, agree = one[together], two[together], agree[together]
    part, turned = consistent(len(ids), one, two, agree)
    area, count = surface.areas[ids], part.max(initial=-1) + 1
    total = np.asarray(np.bincount(part, weights=area, minlength=count), dtype=np.float64)
    decided = np.bincount(part, weights=area * fixed, minlength=count)  # by the file
    deciding = area * np.where(decided[part] > 0, fixed, True)
    against = np.bincount(part, weights=deciding * turned, minlength=count)
    turned ^= (against > np.where(decided > 0, decided, total) / 2)[part]
    open_parts = _Parts(ids, part, turned, np.where(decided > 0, 0.0, total))
    turned ^= _inside_out(surface, open_parts, clear, index, glazed)[part]
    turned &= ~fixed
    none = np.zeros(len(surface.faces), dtype=bool)
    result = Orientation(none, np.full(len(surface.faces), -1), none.copy())
    result.flipped[ids], result.component[ids] = turned, part
    result.closed[ids] = _closed(surface, ids, turned, part, one, two, agree)
    return result


def _closed(surface: Surface, ids: Int, turned: Bool, part: Int, one: Int, two: Int, agree: Bool) -> Bool:
    """(F,) faces of parts of which each face has three neighbours that agree with it, and whose volume is positive."""
    same = agree == (turned[one] == turned[two])
    beside = np.bincount(np.concatenate([one[same], two[same]]), minlength=len(ids))
    whole = np.bincount(part, weights=beside == 3) == np.bincount(part)
    height = np.einsum("ni,ni->n", surface.positions[surface.faces[ids, 0]], surface.normals[ids])
    volume = np.bincount(part, weights=height * surface.areas[ids] * np.where(turned, -1, 1))
    return np.asarray((whole & (volume > 0))[part])


@dataclass(frozen=True, eq=False)
class _Parts:
    """The parts of a surface, within which faces agree.

    Attributes:
        ids: (N,) the faces that belong to parts.
        part: (N,) the part of each.
        turned: (N,) which of them are turned so far.
        undecided: (P,) the area of each part whose winding is not the file's to say; 0 for others.
    """

    ids: Int
    part: Int
    turned: Bool
    undecided: Float


def _inside_out(surface: Surface, parts: _Parts, clear: Bool, index: SpatialIndex, glazed: SpatialIndex) -> Bool:
    """(P,) undecided parts that are seen by their backs, from the outside, clearly more than by their fronts."""
    ids, part, turned = parts.ids, parts.part, parts.turned
    total = np.asarray(np.bincount(part, weights=surface.areas[ids], minlength=len(parts.undecided)), dtype=np.float64)
    asked = np.argsort(-parts.undecided, kind="stable")[:PARTS]
    asked = asked[parts.undecided[asked] > 0]
    by_part = np.argsort(part, kind="stable")
    cumulative = np.cumsum(surface.areas[ids[by_part]])
    ends = np.cumsum(total)
    # Even steps along each part's area; the golden section spreads the points over their triangles.
    along = (ends - total)[asked, None] + (np.arange(SAMPLES) + 0.5) / SAMPLES * total[asked, None]
    picked = by_part[np.minimum(np.searchsorted(cumulative, along.ravel()), len(ids) - 1)]
    picked_part = np.repeat(asked, SAMPLES)
    root = np.sqrt((np.arange(len(picked)) * 0.618034 + 0.5) % 1.0)[:, None]
    second = ((np.arange(len(picked)) * 0.754878 + 0.5) % 1.0)[:, None]
    a, b, c = (surface.positions[surface.faces[ids[picked], corner]] for corner in range(3))
    points = (1 - root) * a + root * (1 - second) * b + root * second * c
    normals = surface.normals[ids[picked]] * np.where(turned[picked], -1.0, 1.0)[:, None]

    directions = fibonacci_directions(DIRECTIONS)
    cosine = product(normals, directions.T)
    point, direction = np.nonzero(np.abs(cosine) > GRAZING)
    side = np.sign(cosine[point, direction])
    origins = points[point] + CLEAR * side[:, None] * normals[point]
    seen = np.zeros(len(point), dtype=bool)
    through = clear[ids[picked[point]]]
    for which, over in ((through, glazed), (~through, index)):
        _, face = over.first_hit(origins[which], directions[direction[which]], Eye.FAR)
        seen[which] = face < 0
    owner = picked_part[point]
    front = np.bincount(owner, weights=seen & (side > 0), minlength=len(total))
    back = np.bincount(owner, weights=seen & (side < 0), minlength=len(total))
    return np.asarray(back > CLEARLY * front)
