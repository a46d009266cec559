"""Selection of boxes that together maximise the objective (:mod:`core.placement.objective`)."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from core.arrays import Bool, Float
from core.geometry.boxes import Boxes
from core.geometry.directions import to_cameras
from core.geometry.spatial import Eye, SpatialIndex
from core.placement.filters import overlapping
from core.placement.objective import Placement, facing

Overlaps = Callable[[list[int]], Bool]  # (B, 1 + K) boxes that must not be used, and those that overlap K others

NEGLIGIBLE = 1e-6  # gain of the objective up to which nothing is exchanged


@dataclass(frozen=True)
class SelectionOptions:
    """Values of :func:`select`: both ours; the paper's boxes may touch, and are never exchanged.

    Attributes:
        spacing: size-30 units between boxes, at least.
        exchanges: at most.
    """

    spacing: float = 0.3
    exchanges: int = 64


SELECTION = SelectionOptions()


def visibility(boxes: Boxes, points: Float, index: SpatialIndex, directions: Float) -> Bool:
    """(B, D) boxes that face the camera in each of the ``directions`` (D, 3), with the rays to it from all of their
    ``points`` (B, N, 3) unobstructed."""
    visible = facing(boxes, directions)
    box, view = np.nonzero(visible)
    origins = points[box]
    toward = to_cameras(origins, directions[view])
    _, face = index.first_hit(origins.reshape(-1, 3), toward.reshape(-1, 3), Eye.FAR)
    visible[box, view] = (face < 0).reshape(origins.shape[:2]).all(axis=1)
    return visible


def select(
    placement: Placement,
    count: int,
    fixed: Sequence[int] = (),
    rejected: Collection[int] = (),
    start: Sequence[int] = (),
    options: SelectionOptions = SELECTION,
) -> list[int]:
    """Indices of at most ``count`` boxes that do not overlap, in the order in which to emboss them.

    They are the better result of :func:`climb` from nothing and from ``start``: a larger choice of boxes never makes
    the result worse.

    Args:
        placement: the survivors.
        count: the most boxes to choose, those in ``fixed`` included.
        fixed: boxes that stay, because they are embossed already; they come first, in this order.
        rejected: boxes that must not be used.
        start: a choice to improve on, as this function returned it; rejected boxes in it are left out.
        options: tuned values.
    """
    afresh = climb(placement, count, fixed, rejected, (), options)
    if set(start) <= set(fixed) | set(rejected):
        return afresh
    return max(afresh, climb(placement, count, fixed, rejected, start, options), key=placement.value)


def climb(
    placement: Placement,
    count: int,
    fixed: Sequence[int] = (),
    rejected: Collection[int] = (),
    start: Sequence[int] = (),
    options: SelectionOptions = SELECTION,
) -> list[int]:
    """As :func:`select`, from ``start`` alone.

    The box with the greatest gain of the objective is added while there is any gain; then single boxes are exchanged or
    dropped while that helps.
    """
    usable = np.ones(len(placement.boxes), dtype=bool)
    usable[list(rejected)] = False
    overlap = cache(lambda one: overlapping(placement.boxes, one, options.spacing))

    def overlaps(chosen: list[int]) -> Bool:
        return np.stack([~usable, *(overlap(one) for one in chosen)], axis=1)

    chosen = list(fixed)
    for one in start:
        if len(chosen) < count and one not in chosen and not overlaps(chosen)[one].any():
            chosen.append(one)
    _add(placement, chosen, overlaps, count)
    for _ in range(options.exchanges):
        if not _exchange(placement, chosen, overlaps, len(fixed)):
            break
        _add(placement, chosen, overlaps, count)
    return chosen


def _add(placement: Placement, chosen: list[int], overlaps: Overlaps, count: int) -> None:
    """Add the box of the greatest gain, while there is any. The first is added without a gain, too: an asset is never
    left unmarked."""
    while len(chosen) < count:
        free = np.flatnonzero(~overlaps(chosen).any(axis=1))
        gain = placement.gain(chosen, free)
        if len(gain) == 0 or (chosen and gain.max() <= 0):
            return
        chosen.append(int(free[gain.argmax()]))


def _exchange(placement: Placement, chosen: list[int], overlaps: Overlaps, fixed: int) -> bool:
    """Make the one change of a single box, another in its place or none, that raises the objective most, if any."""
    if len(chosen) == fixed:
        return False
    met = overlaps(chosen)
    among = np.flatnonzero(met.sum(axis=1) <= 1)  # others would take the places of two
    met = met[among]
    gain = placement.gain_without(chosen, among)[:, fixed:]
    own = gain[np.searchsorted(among, chosen[fixed:]), np.arange(gain.shape[1])]
    gain[(met.sum(axis=1, keepdims=True) != met[:, 1:])[:, fixed:]] = -np.inf
    best, which = gain.max(axis=0), among[gain.argmax(axis=0)]
    better = np.maximum(best, 0 if len(chosen) > 1 else -np.inf) - own
    position = int(better.argmax())
    if better[position] <= NEGLIGIBLE:
        return False
    if best[position] > 0 or len(chosen) == 1:
        chosen[fixed + position] = int(which[position])
    else:
        chosen.pop(fixed + position)
    return True
