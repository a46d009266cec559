"""Orientation of faces that are drawn from both sides: neighbours are made to agree, then each component is flipped
where rays from outside meet its back. Faces that are drawn from their front only are not flipped."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.directions import fibonacci_directions
from core.geometry.products import product
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.surface import Surface
from core.geometry.winding import consistent

CLEAR = 1e-3  # size-30 units between the surface and the origins of rays


@dataclass(frozen=True)
class OrientationOptions:
    """Values of :func:`orient`: all ours; the paper says nothing of winding.

    Attributes:
        components: tested, the largest first.
        samples: points on each component.
        directions: of rays from each point.
        grazing: cosine; rays at less than this to the face do not count.
        clearly: ratio of rays that leave from the back of a component to those from its front, from which on it is
            inside out. For an open sheet both are about equal: it keeps the file's winding.
    """

    components: int = 1024
    samples: int = 16
    directions: int = 24
    grazing: float = 0.1
    clearly: float = 4


ORIENTATION = OrientationOptions()


@dataclass(frozen=True, eq=False)
class Orientation:
    """Orientation of a surface's faces.

    Attributes:
        flipped: (F,) faces whose winding must be reversed for their normals to face outwards.
        component: (F,) number of each face's component, -1 where it does not count.
        closed: (F,) faces of closed components of positive volume.
    """

    flipped: Bool
    component: Int
    closed: Bool


def orient(
    surface: Surface,
    distinct: Bool,
    one_sided: Bool,
    clear: Bool,
    index: SpatialIndex,
    glazed: SpatialIndex,
    options: OrientationOptions = ORIENTATION,
) -> Orientation:
    """The :class:`Orientation` of a surface.

    Components are faces connected through edges of exactly two. Within a component the winding of most of its area is
    right, and faces that disagree with it are flipped; then the component as a whole is flipped if rays leave the asset
    from its back rather than from its front. A one-sided (Moebius) component stays as it is. Faces that are drawn from
    their front only are never flipped: the rest of their component follows most of them, and two of them that disagree
    are never in one component.

    Args:
        surface: the asset.
        distinct: (F,) the faces that count (``CoincidentFaces.distinct``); the others are never flipped.
        one_sided: (F,) the faces that are drawn from their front only.
        clear: (F,) the faces that are see-through.
        index: over the asset; see-through faces do not occlude.
        glazed: the same, but they do; see-through components are judged by it.
        options: tuned values.
    """
    ids = np.flatnonzero(distinct)
    first, second, agree = surface.edges.among(distinct).pairs()
    number = np.cumsum(distinct) - 1
    one, two = number[first // 3], number[second // 3]
    fixed = one_sided[ids]
    together = agree | ~fixed[one] | ~fixed[two]
    one, two, agree = one[together], two[together], agree[together]
    component, flipped = consistent(len(ids), one, two, agree)
    area, count = surface.areas[ids], component.max(initial=-1) + 1
    total = np.asarray(np.bincount(component, weights=area, minlength=count), dtype=np.float64)
    decided = np.bincount(component, weights=area * fixed, minlength=count)  # by the file
    deciding = area * np.where(decided[component] > 0, fixed, True)
    against = np.bincount(component, weights=deciding * flipped, minlength=count)
    flipped ^= (against > np.where(decided > 0, decided, total) / 2)[component]
    components = _Components(ids, component, flipped, np.where(decided > 0, 0.0, total))
    flipped ^= _inside_out(surface, components, clear, index, glazed, options)[component]
    flipped &= ~fixed
    none = np.zeros(len(surface.faces), dtype=bool)
    result = Orientation(none, np.full(len(surface.faces), -1), none.copy())
    result.flipped[ids], result.component[ids] = flipped, component
    result.closed[ids] = _closed(surface, ids, flipped, component, one, two, agree)
    return result


def _closed(surface: Surface, ids: Int, flipped: Bool, component: Int, one: Int, two: Int, agree: Bool) -> Bool:
    """(F,) faces of components in which each face has three neighbours that agree with it, of positive volume."""
    same = agree == (flipped[one] == flipped[two])
    beside = np.bincount(np.concatenate([one[same], two[same]]), minlength=len(ids))
    whole = np.bincount(component, weights=beside == 3) == np.bincount(component)
    height = np.einsum("ni,ni->n", surface.positions[surface.faces[ids, 0]], surface.normals[ids])
    volume = np.bincount(component, weights=height * surface.areas[ids] * np.where(flipped, -1, 1))
    return np.asarray((whole & (volume > 0))[component])


@dataclass(frozen=True, eq=False)
class _Components:
    """The components of a surface, within which faces agree.

    Attributes:
        ids: (N,) the faces that belong to components.
        component: (N,) the component of each.
        flipped: (N,) those that are flipped so far.
        undecided: (P,) the area of each component whose winding the file does not decide; 0 for others.
    """

    ids: Int
    component: Int
    flipped: Bool
    undecided: Float


def _inside_out(
    surface: Surface,
    components: _Components,
    clear: Bool,
    index: SpatialIndex,
    glazed: SpatialIndex,
    options: OrientationOptions,
) -> Bool:
    """(P,) undecided components from whose backs clearly more rays leave the asset than from their fronts."""
    ids, component, flipped = components.ids, components.component, components.flipped
    count = len(components.undecided)
    total = np.asarray(np.bincount(component, weights=surface.areas[ids], minlength=count), dtype=np.float64)
    tested = np.argsort(-components.undecided, kind="stable")[: options.components]
    tested = tested[components.undecided[tested] > 0]
    by_component = np.argsort(component, kind="stable")
    cumulative = np.cumsum(surface.areas[ids[by_component]])
    ends = np.cumsum(total)
    # Even steps along each component's area; the golden section spreads the points over their triangles.
    along = (ends - total)[tested, None] + (np.arange(options.samples) + 0.5) / options.samples * total[tested, None]
    picked = by_component[np.minimum(np.searchsorted(cumulative, along.ravel()), len(ids) - 1)]
    picked_component = np.repeat(tested, options.samples)
    root = np.sqrt((np.arange(len(picked)) * 0.618034 + 0.5) % 1.0)[:, None]
    second = ((np.arange(len(picked)) * 0.754878 + 0.5) % 1.0)[:, None]
    a, b, c = (surface.positions[surface.faces[ids[picked], corner]] for corner in range(3))
    points = (1 - root) * a + root * (1 - second) * b + root * second * c
    normals = surface.normals[ids[picked]] * np.where(flipped[picked], -1.0, 1.0)[:, None]

    directions = fibonacci_directions(options.directions)
    cosine = product(normals, directions.T)
    point, direction = np.nonzero(np.abs(cosine) > options.grazing)
    side = np.sign(cosine[point, direction])
    origins = points[point] + CLEAR * side[:, None] * normals[point]
    seen = np.zeros(len(point), dtype=bool)
    through = clear[ids[picked[point]]]
    for which, over in ((through, glazed), (~through, index)):
        _, face = over.first_hit(origins[which], directions[direction[which]], Eye.FAR)
        seen[which] = face < 0
    owner = picked_component[point]
    front = np.bincount(owner, weights=seen & (side > 0), minlength=len(total))
    back = np.bincount(owner, weights=seen & (side < 0), minlength=len(total))
    return np.asarray(back > options.clearly * front)
