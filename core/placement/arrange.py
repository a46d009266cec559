"""Places to which a designer would move the chosen marks: in the middle of their ground, level, on a neighbour's
baseline, and wider as far as there is room."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Float, Int
from core.geometry.boxes import Boxes
from core.geometry.products import cross
from core.geometry.spatial import SpatialIndex
from core.placement.candidates import POLE, upright
from core.placement.filters import cast, held
from core.placement.pairs import ragged


@dataclass(frozen=True)
class ArrangeOptions:
    """Values of the moves: all ours; the paper leaves marks where they were fitted.

    Attributes:
        reach: text heights from a mark within which its ground is looked for; with more on two sides it stands free.
        step: of these, text heights.
        sides: rays along a text's longer side and its shorter one.
        held: share of the rays beside a text that meet its ground, at least.
        slanted: sine of a roll from which on a level text is tried.
        growth: ratio of widths when text is widened.
        growth_steps: of it, from each width to nearly the next wider one.
    """

    reach: float = 2.0
    step: float = 0.125
    sides: tuple[int, int] = (17, 5)
    held: float = 0.9
    slanted: float = 0.02
    growth: float = 1.1
    growth_steps: int = 5


ARRANGE = ArrangeOptions()


def moved(
    boxes: Boxes, height: Float, index: SpatialIndex, normals: Float, component: Int, options: ArrangeOptions = ARRANGE
) -> Boxes:
    """The ``boxes``, level and as they are, in the middle of their ground along the text, across it and both; and on
    the baselines of their neighbours.

    Args:
        boxes: on the surface, size-30 units.
        height: (B,) of a line of the text in each.
        index: over the surface.
        normals: (F, 3) unit normals of its faces.
        component: (F,) of its faces, as for :func:`core.placement.filters.fully_supported`.
        options: tuned values.
    """
    axes = upright(boxes.axes[:, 2])
    roll = np.abs((boxes.axes[:, 1] * axes[:, 0]).sum(axis=1))
    turned = np.flatnonzero((np.abs(boxes.axes[:, 2, 1]) < POLE) & (roll > options.slanted))
    level = Boxes(boxes.center[turned], axes[turned], boxes.size[turned])
    both = Boxes.concat(boxes, level)
    shift = _to_middle(both, np.concatenate([height, height[turned]]), index, normals, component, options)
    centred = []
    for way in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0)):
        center = both.center + np.einsum("bk,bkj->bj", shift * way, both.axes[:, :2])
        away = np.flatnonzero((shift * way).any(axis=1))
        centred.append(Boxes(center[away], both.axes[away], both.size[away]))
    return Boxes.concat(level, *centred, _on_baselines(boxes))


def wider(boxes: Boxes, most: Float, thinnest: float, options: ArrangeOptions = ARRANGE) -> Boxes:
    """The ``boxes`` in several widths below the ``most`` (B,) of each, no thinner than ``thinnest``; size-30 units."""
    found = Boxes.empty()
    for step in range(1, options.growth_steps + 1):
        size = np.maximum(boxes.size * options.growth**step, (0.0, 0.0, thinnest))
        room = np.flatnonzero(size[:, 0] < most)
        found = Boxes.concat(found, Boxes(boxes.center[room], boxes.axes[room], size[room]))
    return found


def _to_middle(
    boxes: Boxes, line: Float, index: SpatialIndex, normals: Float, component: Int, options: ArrangeOptions
) -> Float:
    """(B, 2) ways to the right and up to the middle of the ground, size-30 units, by the height (B,) of a ``line``; 0
    where there is enough on either side."""
    away = np.arange(options.step, options.reach + options.step / 2, options.step)
    half, height = boxes.size[:, None, None, :2] / 2, line[:, None]
    room = np.zeros((len(boxes), 2, 2))
    for axis, count in enumerate(reversed(options.sides)):
        for side, sign in enumerate((-1.0, 1.0)):
            local = np.zeros((len(boxes), len(away) + 1, count, 2))  # the first row is the middle
            local[:, 1:, :, axis] = sign * (half[..., axis] + (height * away)[..., None])
            local[:, 1:, :, 1 - axis] = half[..., 1 - axis] * np.linspace(-1, 1, count)
            met = cast(boxes, local.reshape(len(boxes), (len(away) + 1) * count, 2), index, normals, line)
            rows = held(met, boxes, component).reshape(len(boxes), len(away) + 1, count)[:, 1:]
            ends = rows.mean(axis=2) < options.held
            room[:, axis, side] = np.where(ends.any(axis=1), away[ends.argmax(axis=1)] - options.step, options.reach)
    return np.asarray((room[..., 1] - room[..., 0]) / 2 * height)


def _on_baselines(boxes: Boxes) -> Boxes:
    """Of every pair that stands beside each other off one baseline, each box moved onto the other's."""
    which, other = np.nonzero(ragged(boxes, boxes))
    one, beside = boxes[which], boxes[other]
    normal = one.axes[:, 2]
    right = beside.axes[:, 0] - (beside.axes[:, 0] * normal).sum(axis=1)[:, None] * normal
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    axes = np.stack([right, cross(normal, right), normal], axis=1)
    above = ((one.center - beside.center) * beside.axes[:, 1]).sum(axis=1) + (beside.size[:, 1] - one.size[:, 1]) / 2
    return Boxes(one.center - above[:, None] * axes[:, 1], axes, one.size)
