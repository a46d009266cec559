"""Which faces are wound inside out: neighbours are made to agree, then each part is looked at from outside."""

import numpy as np
from numpy.typing import NDArray

from core.asset.surface import Surface
from core.asset.winding import consistent, neighbours
from core.rendering.views import fibonacci_directions
from core.spatial import SpatialIndex

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]

PARTS, SAMPLES, DIRECTIONS = 1024, 16, 24  # parts asked, the largest first; points on each; rays from each point
GRAZING = 0.1  # cosine under which a ray tells nothing about a side
CLEAR = 1e-3  # where rays start off the surface, size-30 units
# A part is inside out when its back is seen from outside this many times as often as its front. Both sides of an
# open sheet are seen about equally: its winding is the file's to say.
CLEARLY = 4


def reversed_faces(surface: Surface, distinct: Bool, index: SpatialIndex) -> tuple[Bool, Int]:
    """(F,) the faces whose winding must be turned for their normals to look out, and the part (F,) that each belongs
    to, -1 where it does not count.

    Parts are faces connected through edges of exactly two. Within a part the winding of most of its area is right,
    and whoever disagrees with it is turned; then the part as a whole is turned if rays leave the asset from its
    back rather than from its front. A one-sided (Moebius) part stays as it is.

    Args:
        surface: the asset.
        distinct: (F,) the faces that count (``sheets.distinct_faces``); the others are never reversed.
        index: over the asset.
    """
    ids = np.flatnonzero(distinct)
    one, two, agree = neighbours(surface.weld[surface.faces[ids]])
    part, turned = consistent(len(ids), one, two, agree)
    area = surface.areas[ids]
    total = np.asarray(np.bincount(part, weights=area), dtype=np.float64)
    turned ^= (np.bincount(part, weights=area * turned) > total / 2)[part]
    turned ^= _inside_out(surface, ids, turned, part, total, index)[part]
    all_turned, all_parts = np.zeros(len(surface.faces), dtype=bool), np.full(len(surface.faces), -1)
    all_turned[ids], all_parts[ids] = turned, part
    return all_turned, all_parts


def _inside_out(surface: Surface, ids: Int, turned: Bool, part: Int, total: Float, index: SpatialIndex) -> Bool:
    """(P,) which parts are seen by their backs, from the outside, clearly more than by their fronts."""
    asked = np.argsort(-total, kind="stable")[:PARTS]
    asked = asked[total[asked] > 0]
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
    cosine = normals @ directions.T
    point, direction = np.nonzero(np.abs(cosine) > GRAZING)
    side = np.sign(cosine[point, direction])
    _, face = index.first_hit(points[point] + CLEAR * side[:, None] * normals[point], directions[direction])
    seen = face < 0
    owner = picked_part[point]
    front = np.bincount(owner, weights=seen & (side > 0), minlength=len(total))
    back = np.bincount(owner, weights=seen & (side < 0), minlength=len(total))
    return np.asarray(back > CLEARLY * front)
