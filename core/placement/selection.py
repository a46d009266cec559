"""Which of the surviving boxes to use: the paper's octants, then its views and all other directions."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from core.placement.boxes import Boxes
from core.placement.filters import overlapping
from core.spatial import SpatialIndex

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]
Free = Callable[[list[int]], Bool]  # which boxes overlap none of the given ones

FACING_VIEW = np.cos(np.radians(45.0))  # a mark turned further away is not readable from that view
SPACING = 0.3  # between boxes, size-30 units
# What one unit of placement cost weighs against the share of all directions covered.
COST_WEIGHT = 0.02
OCTANTS = 8
SWEEPS = 3


@dataclass(frozen=True, eq=False)
class Placement:
    """All boxes that survived the filters, and what choosing among them needs.

    Attributes:
        boxes: B boxes, size-30 units.
        loss: (B,) mean squared distance of the outline to the surface, squared size-30 units.
        roughness: (B,) mean of 1/cos between normals; 1 is flat.
        cost: (B,) placement cost, 0 is best (see ``place``).
        visible: (B, D) whether the box faces a direction within 45 degrees and all its rays get out.
        directions: (D, 3) unit vectors from the asset towards the camera.
        weight: (D,) what covering a direction is worth; sums to 1.
    """

    boxes: Boxes
    loss: Float
    roughness: Float
    cost: Float
    visible: Bool
    directions: Float
    weight: Float

    @cached_property
    def faced(self) -> Float:
        """(B, D) 1 where a box faces a direction within 45 degrees, visible there or not."""
        return facing(self.boxes, self.directions).astype(np.float64)

    @cached_property
    def seen(self) -> Float:
        """(B, D) ``visible`` as numbers."""
        return self.visible.astype(np.float64)

    @cached_property
    def octant(self) -> Int:
        """(B,) 0-7: which side of the planes through the asset's centre the box is on."""
        return np.asarray((self.boxes.center > 0) @ np.array([1, 2, 4]), dtype=np.int64)


def facing(boxes: Boxes, directions: Float) -> Bool:
    """(B, D) which boxes look along each direction (D, 3) within 45 degrees."""
    return np.asarray(boxes.axes[:, 2] @ directions.T >= FACING_VIEW)


def visibility(boxes: Boxes, points: Float, index: SpatialIndex, directions: Float) -> Bool:
    """(B, D) which boxes face each direction and have nothing in the way of any of their ``points`` (B, N, 3)."""
    visible = facing(boxes, directions)
    box, view = np.nonzero(visible)
    origins = points[box]
    toward = np.broadcast_to(directions[view][:, None, :], origins.shape)
    _, face = index.first_hit(origins.reshape(-1, 3), toward.reshape(-1, 3))
    visible[box, view] = (face < 0).reshape(origins.shape[:2]).all(axis=1)
    return visible


def select(placement: Placement, count: int, fixed: Sequence[int] = (), dead: Collection[int] = ()) -> list[int]:
    """Indices of at most ``count`` boxes that do not overlap, in the order in which to emboss them.

    First one box an octant, the one furthest from those already chosen among the cheaper half (paper,
    "Multi-Octant Presence"). Then whatever adds most to the views, while anything does: each of the 24 views of
    "Multi-Angle Visibility" weighs as much as eight of the 200 even directions, so views that see no mark yet come
    first. Last, single boxes are swapped where that helps and no octant loses its only mark. With ``count`` under
    eight there is not one for each octant, and the views decide from the start.

    Args:
        placement: the survivors.
        count: the most boxes to choose, those in ``fixed`` included.
        fixed: boxes that stay, because they are embossed already; they come first, in this order.
        dead: boxes that must not be used.
    """
    chosen = list(fixed)
    usable = np.ones(len(placement.boxes), dtype=bool)
    usable[list(dead)] = False
    overlap = cache(lambda one: overlapping(placement.boxes, one, SPACING))

    def free(chosen: list[int]) -> Bool:
        return np.asarray(np.all([usable, *(~overlap(one) for one in chosen)], axis=0))

    if count >= OCTANTS:
        _add_octants(placement, chosen, free, count)
    _add_coverage(placement, chosen, free, count)
    _swap(placement, chosen, free, len(fixed), keep_octants=count >= OCTANTS)
    return chosen


def _gain(placement: Placement, chosen: list[int]) -> Float:
    """(B,) what each box would add to the objective.

    That is the weighted mean over all directions of the paper's score of a view (the share visible among the
    marks that face it, 0 where none does), less the placement cost.
    """
    seen, faced = placement.seen[chosen].sum(axis=0), placement.faced[chosen].sum(axis=0)
    # One more box facing a direction turns seen/faced into seen/(faced + 1), or (seen + 1)/(faced + 1) where visible.
    dilution = placement.weight * (seen / (faced + 1) - seen / np.maximum(faced, 1))
    addition = placement.weight / (faced + 1)
    return np.asarray(placement.faced @ dilution + placement.seen @ addition - COST_WEIGHT * placement.cost)


def _add_octants(placement: Placement, chosen: list[int], free: Free, count: int) -> None:
    for octant in range(OCTANTS):
        if len(chosen) >= count or octant in placement.octant[chosen]:
            continue
        inside = np.flatnonzero(free(chosen) & (placement.octant == octant))
        if len(inside) == 0:
            continue
        cheap = inside[placement.cost[inside] <= np.median(placement.cost[inside])]
        if chosen:
            apart = placement.boxes.center[cheap][:, None] - placement.boxes.center[chosen][None]
            best = np.linalg.norm(apart, axis=2).min(axis=1).argmax()
        else:
            best = placement.cost[cheap].argmin()
        chosen.append(int(cheap[best]))


def _add_coverage(placement: Placement, chosen: list[int], free: Free, count: int) -> None:
    """Add the box that gains most, while any gains."""
    while len(chosen) < count:
        gain = np.where(free(chosen), _gain(placement, chosen), -np.inf)
        if len(gain) == 0 or gain.max() <= 0:
            return
        chosen.append(int(gain.argmax()))


def _swap(placement: Placement, chosen: list[int], free: Free, fixed: int, keep_octants: bool) -> None:
    """Replace single boxes while the objective rises."""
    for _ in range(SWEEPS):
        before = list(chosen)
        for position in range(fixed, len(chosen)):
            others = chosen[:position] + chosen[position + 1 :]
            gain, allowed = _gain(placement, others), free(others)
            octant = placement.octant[chosen[position]]
            if keep_octants and octant not in placement.octant[others]:
                allowed &= placement.octant == octant
            best = int(np.where(allowed, gain, -np.inf).argmax())
            if gain[best] > gain[chosen[position]] + 1e-9:
                chosen[position] = best
        if chosen == before:
            return
