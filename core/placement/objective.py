"""The objective of placement: one number for a choice of marks, which selection maximises.

With candidate boxes m, a choice S of them, targets j, and fields of :class:`Objective` in capitals::

    F(S) = sum over j of w_j (best_j + REDUNDANCY second_j)  -  sum over m in S of cost_m
           -  sum over pairs in S of pair(m, n)

where ``best_j`` and ``second_j`` are the largest and the second largest L[m, j] over m in S, and ``L[m, j]``, 0 to
1, is how well mark m covers target j: from each direction the most legible visible mark counts; the second best counts
with a small weight, for when the first is removed. The targets are

* the paper's 24 views and 200 even directions, each set worth half (``w`` sums to 1 over them)::

      L = visible (SEEN + (1 - SEEN) size x facing x roll x flatness)

  Visible is 1 where the mark faces the direction within 45 degrees and rays from all over its letters get out; size is
  the legibility of text of this height, coloured or not (:mod:`core.placement.legibility`), for the projected height
  times the contrast of the letters with the base colour under them, whose variation masks uncoloured ones, see
  :func:`contrast`; facing is the cosine over that of 40 degrees, at most 1; roll is ``1 - ROLLED (1 - cos r) / 2`` for
  the angle r between the text and the picture's horizontal (1 for the even directions, whose pictures have no up);
  flatness is 1 less the curvature deviation under the text;
* 64 half-spaces through the surface's centroid, together worth ``CROPS``: L = 1 where the whole mark lies in the
  half-space, so that a crop by the plane leaves it.

``pair`` is PROXIMITY_WEIGHT times 1 less the distance of the centres over 5, at least 0, for marks on the same side of
the surface: marks close together are removed together; the term keeps them apart. To it come STACKED for lines above
each other on one face, and RAGGED for those beside each other off one baseline (:mod:`core.placement.pairs`): where two
marks stand on one face, they stand as a designer would set them.

F is submodular (the two largest of a set, the second weighing less; pairs only take away): a mark that shows only what
two others show better adds nothing. Were it monotone too, greedy choice would reach 1 - 1/e of the best (Nemhauser,
Wolsey, Fisher 1978); exchanging marks only adds to it. A noisy-or in place of the two largest counts every mark that
shows a view, which stacks them on the best places. Without the second mark (REDUNDANCY 0) 10.7 marks on sixteen assets
were read in 0.77 of the views, with it 14.2 marks in 0.84. ::

    cost_m = PENALTY (6 obstructed + 1.4 salient + 3 sin(roll) + curvature_deviation + (roughness - 1)
                      + 3 edge_proximity + 6 folded + 40 articulation + 1.4 detail + busy
                      + max(6 face, 4 last_resort, 2 feature) - preferred)
             + MARK + min(DISTORTION x (the letters' share of the surface) x relief, 0.05)

Obstructed is the share of the directions a mark faces in which it is not visible (the paper's Ray punishes it); salient
the share of salient surface under it; edge proximity the share of a margin around it that has no supporting surface
(edges, silhouettes, holes); folded the share on ground that an edge turns away; articulation the number of joints that
share the skin under it (letters on an elbow are torn in other poses); detail the share on eyes, logos or print in the
texture; busy the variance of colours there; face and feature whether it touches a face, and what may be a feature by
its shape (:mod:`core.analysis.features`); preferred the share on regions asked for. Thin walls take no sunken letters
at all (:func:`core.placement.filters.thin_walled`), and marks do not overlap (selection). Seams of the texture cost
nothing of their own: letters carry the texture of either side, and a change of colour at a seam counts as busy. Marks
on surface that is mostly salient, or a third of it detail, are a last resort: such a mark has to show what a few views
or a tenth of the even directions see nothing else of. The last two terms are the price of any mark: one that adds less
is not placed. This takes the place of the paper's octants, which spread marks without asking what they show.

With PROMINENT, which strong marks ask for, that share of legibility counts only up to text LARGE times as high.

The effect of each term on the metrics is in the report of ``meshmark benchmark --methods objective``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bool, Float, Int
from core.geometry.boxes import Boxes
from core.geometry.directions import cosines_to_cameras, fibonacci_directions, looks_at_cameras, view_directions
from core.geometry.products import product
from core.geometry.surface import Surface
from core.gltf.colors import cielab, hex_linear
from core.placement.legibility import legibility
from core.placement.pairs import proximity, ragged, stacked

Single = NDArray[np.float32]

FACING_VIEW = float(np.cos(np.radians(45.0)))  # a mark turned further away is not readable from that view
WORTH_DIGITS = 6  # of an objective that is about 1
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # weights of linear sRGB (ITU-R BT.709)


@dataclass(frozen=True)
class Objective:
    """Values of the terms; see the module. All ours: the paper filters by octants and views, and has no objective. Only
    ablations change them: they set a weight to 0.

    The proportions come from sweeps over the survivors on 33 assets: fewer penalties leave no view without a mark, more
    on roll and saliency keeps text upright (4 degrees in the mean) and features free, and obstructed counts most
    because it is in every view's picture. With distortion at 20 SMSE is a sixth larger, and text reads no better.
    """

    even_directions: int = 200  # beside the paper's 24 views
    half_spaces: int = 64
    seen: float = 0.5  # of covering a direction, for being visible there at all
    redundancy: float = 0.15  # of covering a target, for the second best mark
    crops: float = 0.1  # all half-spaces together; nearly any choice of a few marks covers nearly all
    prominent: float = 0.0  # share of legibility that text has to be ``large`` times as high for as the rest
    large: float = 3.0
    legibility: float = 1.0  # exponent of size x facing x roll x flatness
    head_on: float = float(np.cos(np.radians(40.0)))  # turned less than this a text reads as well as from the front
    rolled: float = 0.5  # readers turn pictures in four ways; people do not
    # CIELAB units between letters and surface that are as good as any. Over 672 views of one mark in six colours on
    # eleven textured assets, 12 to 20 pixels high, recognition reads 0.37 to 0.69 below 30 and 0.8 to 0.9 above; by
    # WCAG 2's contrast ratio, in which red and grey hardly differ, 0.76 to 0.84 below 3 and 0.87 above.
    distinct: float = 50.0
    min_contrast: float = 0.5  # factor, at least: gloss and edges show letters as dark as the surface
    # Variation of the colours under letters without one of their own (1 is 30 CIELAB units) for which they have to be
    # sqrt 2 times as high. Over 209 marks, twice each, on 16 textured assets, the height times this and the lightness
    # of the ground ranks what recognition reads with 0.85 (Spearman), without this with 0.81, height alone with 0.72.
    masking: float = 0.53
    penalty: float = 0.005  # share of all directions that one unit of the terms from here to ``preferred`` costs
    obstructed: float = 6.0
    salient: float = 1.4
    roll: float = 3.0
    curvature_deviation: float = 1.0
    rough: float = 1.0
    edge_proximity: float = 3.0
    folded: float = 6.0  # of the share on ground that is turned away by an edge
    articulation: float = 40.0  # text torn by joints is worth nothing in motion
    detail: float = 1.4
    busy: float = 1.0
    face: float = 6.0  # of a box that touches one; at 16 a fox has no mark that is seen from the front
    feature: float = 2.0
    preferred: float = 1.0
    mark: float = 0.0003  # a mark has to add more than an eighth of one of the 200 directions
    # Of a pair of marks at one place: more than the second is worth but on the only side of its kind.
    proximity_weight: float = 0.01
    proximity_range: float = 5.0  # between the centres of marks, size-30 units
    stacked: float = 0.004  # of two lines in a stack on one face
    ragged: float = 0.002  # of two beside each other on one face, but not on one baseline
    distortion: float = 35.0  # per unit of mean distance (SMSE) that a mark adds
    most_distorted: float = 0.05  # bound of that term, so that text requested as large as a side is on all sides
    last_resort: float = 4.0  # of a box mostly on salient parts or details
    max_salient: float = 0.45  # share, at most, of other marks; the metric's 0.5 less what the edges of a box hold
    max_detail: float = 0.3  # likewise: an eye or a line of print is a small part of a box
    max_feature: float = 0.05  # likewise on a face or feature: more than the samples at its border is touching it


OBJECTIVE = Objective()


@dataclass(frozen=True, eq=False)
class Targets:
    """The targets that marks are to cover.

    Attributes:
        directions: (D, 3) unit vectors from the asset towards the camera, the 24 views first.
        up: (24, 3) the pictures' up in the views.
        half_spaces: (H, 3) unit normals of planes through ``centroid``, pointing to the kept side.
        centroid: (3,) of the surface.
        weight: (D + H,) the weight of covering each target.
    """

    directions: Float
    up: Float
    half_spaces: Float
    centroid: Float
    weight: Float


def centroid(surface: Surface) -> Float:
    """(3,) of a surface with area, size-30 units."""
    corners = (surface.positions.take(surface.faces[:, corner], axis=0) for corner in range(3))
    moment = sum((surface.areas[:, None] * corner).sum(axis=0) for corner in corners)
    return np.asarray(moment / (3 * surface.areas.sum()))


def targets(surface: Surface, objective: Objective = OBJECTIVE) -> Targets:
    """The targets of an asset."""
    (views, up), even = view_directions(), fibonacci_directions(objective.even_directions)
    counts = [len(views), len(even), objective.half_spaces]
    weight = np.repeat([0.5 / len(views), 0.5 / len(even), objective.crops / objective.half_spaces], counts)
    half_spaces = fibonacci_directions(objective.half_spaces)
    return Targets(np.concatenate([views, even]), up, half_spaces, centroid(surface), weight)


@dataclass(frozen=True, eq=False)
class Placement:
    """All boxes that passed the filters, with their coverage and cost.

    Attributes:
        boxes: B boxes, size-30 units.
        loss: (B,) mean squared distance of the outline to the surface, squared size-30 units.
        roughness: (B,) mean of 1/cos between normals; 1 is flat.
        visible: (B, D) whether the box faces a direction within 45 degrees and all its rays get out.
        likelihood: (B, J) float32 how well the box covers each target, 0 to 1.
        cost: (B,) in the unit of ``weight``.
        last_resort: (B,) boxes on salient parts; better ones are looked for in the directions that only they cover.
        weight: (J,) the weight of covering each target.
        objective: the values of the terms.
        start: a good choice among the boxes, which selection improves on.
    """

    boxes: Boxes
    loss: Float
    roughness: Float
    visible: Bool
    likelihood: NDArray[np.float32]
    cost: Float
    last_resort: Bool
    weight: Float
    objective: Objective = OBJECTIVE
    start: tuple[int, ...] = ()

    def coverage(self, chosen: Sequence[int]) -> tuple[Single, Single]:
        """(J,) each: how well the best and the second best of the ``chosen`` boxes cover each target."""
        (best, second, _), _ = self._leaders(chosen)
        return best, second

    def gain(self, chosen: Sequence[int], among: Int) -> Float:
        """(M,) the gain in the objective from adding each of the boxes ``among`` (M,) to the ``chosen``."""
        best, second = self.coverage(chosen)
        added = (self._added(self.likelihood[among], best, second) * self.weight).sum(axis=1)
        return _even(added - self.pairs(chosen)[among].sum(axis=1) - self.cost[among])

    def gain_without(self, chosen: Sequence[int], among: Int) -> Float:
        """(M, K) :meth:`gain` where each of the K ``chosen`` boxes in turn is left out.

        Only in those targets does that make a difference in which the one left out is best or second best.
        """
        (best, second, third), owner = self._leaders(chosen)
        likelihood = self.likelihood[among]
        whole = self._added(likelihood, best, second) * self.weight
        gain = np.repeat(whole.sum(axis=1)[:, None], len(chosen), axis=1)
        for rank, (one, other) in enumerate([(second, third), (best, third)]):
            order = np.argsort(owner[rank], kind="stable")
            order = order[np.searchsorted(owner[rank][order], 0) :]  # without the targets that nothing covers
            if len(order):
                numbers, first = np.unique(owner[rank][order], return_index=True)
                without = self._added(likelihood[:, order], one[order], other[order]) * self.weight[order]
                without -= whole[:, order]
                gain[:, numbers] += np.add.reduceat(without, first, axis=1)
        pairs = self.pairs(chosen)[among]
        return _even(gain - (pairs.sum(axis=1, keepdims=True) - pairs) - self.cost[among, None])

    def _leaders(self, chosen: Sequence[int]) -> tuple[Single, Int]:
        """(3, J) the three largest likelihoods of the ``chosen`` boxes for each target, 0 where there are fewer, and
        (2, J) which of ``chosen`` has the largest and the second largest; -1 for none."""
        none = np.zeros((3, self.likelihood.shape[1]), np.float32)
        rows = np.concatenate([self.likelihood[list(chosen)], none])
        order = np.argsort(-rows, axis=0, kind="stable")[:3]
        return np.take_along_axis(rows, order, axis=0), np.where(order < len(chosen), order, -1)[:2]

    def _added(self, likelihood: Single, best: Single, second: Single) -> Single:
        """(B, J) the gain of each box, of a ``likelihood`` (B, J), in targets that others cover ``best`` and ``second``
        best (J,)."""
        redundant = np.minimum(likelihood, best)
        redundant -= second
        np.maximum(redundant, 0, out=redundant)
        redundant *= self.objective.redundancy
        added = likelihood - best
        np.maximum(added, 0, out=added)
        added += redundant
        return added

    def pairs(self, chosen: Sequence[int]) -> Float:
        """(B, K) what each box costs beside each of the K ``chosen``; 0 for itself."""
        for one in chosen:
            if one not in self._beside:
                self._beside[one] = self._pair(one)
        columns = [self._beside[one][:, None] for one in chosen]
        return np.concatenate([np.empty((len(self.boxes), 0)), *columns], axis=1)

    @cached_property
    def _beside(self) -> dict[int, Float]:
        """The columns of :meth:`pairs` that were asked for before: choices hardly change from one to the next."""
        return {}

    def _pair(self, one: int) -> Float:
        """(B,) what each box costs beside box ``one``; 0 for itself."""
        objective, other = self.objective, self.boxes[np.array([one])]
        price = (
            objective.proximity_weight * proximity(self.boxes, other, objective.proximity_range)
            + objective.stacked * stacked(self.boxes, other)
            + objective.ragged * ragged(self.boxes, other)
        )[:, 0]
        price[one] = 0
        return np.asarray(price)

    def value(self, chosen: Sequence[int]) -> float:
        """The objective F of ``chosen``."""
        best, second = self.coverage(chosen)
        pairs = self.pairs(chosen)[list(chosen)].sum() / 2
        covered = (self.weight * (best + self.objective.redundancy * second)).sum()
        return float(_even(covered - self.cost[list(chosen)].sum() - pairs))


def _even(worth: Float) -> Float:
    """``worth`` without its last digits, which may differ from one machine to another: what is as good as equal is
    equal, and the first of equals is chosen."""
    return np.asarray(np.round(worth, WORTH_DIGITS))


def facing(boxes: Boxes, directions: Float) -> Bool:
    """(B, D) which boxes look to the camera in each direction (D, 3) within 45 degrees."""
    return looks_at_cameras(boxes.center, boxes.axes[:, 2], directions, FACING_VIEW)


def contrast(ground: Float, busy: Float, palette: Sequence[str], objective: Objective = OBJECTIVE) -> Float:
    """(B,) contrast of letters with each colour of the ``ground`` (B, 3), linear sRGB, whose variance there is ``busy``
    (B,), see :class:`core.analysis.texture.TextureSaliency`: 0 to 1.

    Letters of a colour of their own, that of the ``palette`` ("#rrggbb") that stands out best, are told from the ground
    by the distance of the two in CIELAB.
    Letters without one are told by their walls, one side of which is lit half as much as the other: on black ground
    neither is seen. The measure is WCAG 2's contrast ratio, whose 0.05 is the light that every screen adds. And the
    texture's own light and dark mask them: as with noise in a picture, the contrast that is needed grows with
    ``sqrt(1 + (variation / masking)^2)``.
    """
    if not palette:
        luminance = product(ground, LUMINANCE[:, None])[:, 0]
        ratio = (luminance + 0.05) / (luminance / 2 + 0.05)
        contrast, masked = (ratio - 1) / (1.05 / 0.55 - 1), np.hypot(1, busy / objective.masking)
    else:
        colors = cielab(np.stack([hex_linear(color) for color in palette]))
        apart = np.linalg.norm(cielab(ground)[:, None] - colors, axis=2).max(axis=1)
        contrast, masked = np.minimum(apart / objective.distinct, 1), np.ones(len(ground))
    return np.asarray((objective.min_contrast + (1 - objective.min_contrast) * contrast) / masked)


def best_possible_coverage(height: float, cosine: Float, colored: bool, objective: Objective = OBJECTIVE) -> Float:
    """(D,) coverage of directions by a mark in the best case: its text has a ``height`` in size-30 units, and is turned
    away by the angles of these ``cosine`` (D,)."""
    legible = _legible(np.array(height), colored, objective) * np.clip(cosine / objective.head_on, 0, 1)
    return np.asarray(objective.seen + (1 - objective.seen) * legible)


def _legible(height: Float, colored: bool, objective: Objective) -> Float:
    """Legibility of text of a ``height`` (any shape), where some of it may be asked of larger text."""
    legible = legibility(height, colored)
    if objective.prominent:
        legible += objective.prominent * (legibility(height / objective.large, colored) - legible)
    return legible


def likelihood(
    boxes: Boxes,
    visible: Bool,
    deviation: Float,
    height: Float,
    goal: Targets,
    colored: bool = False,
    objective: Objective = OBJECTIVE,
) -> Single:
    """(B, J) how well each box covers each target, 0 to 1.

    Args:
        boxes: size-30 units.
        visible: (B, D) directions in which each is visible.
        deviation: (B,) curvature deviation of the surface under each, see :func:`curvature_deviation`.
        height: (B,) of a line of text in each, size-30 units, times the contrast of letters with the ground, see
            :func:`contrast`: the two stand in for each other, fainter text has to be larger.
        goal: the targets.
        colored: letters have a colour of their own, not that of the ground.
        objective: the values of the terms.
    """
    ahead, upwards = (cosines_to_cameras(boxes.center, boxes.axes[:, axis], goal.directions) for axis in (2, 1))
    cosine = np.clip(ahead, 0, 1)
    # The text is as high on the picture as its up is long there.
    upright_length = np.sqrt(np.clip(1 - upwards**2, 0, 1))
    turned = np.minimum(1.0, cosine / objective.head_on)
    legible = _legible(height[:, None] * upright_length, colored, objective)
    legible = legible * turned * np.clip(1 - deviation, 0, 1)[:, None]
    # The text's right on the picture: how far along its horizontal, how far along its vertical.
    views = goal.directions[: len(goal.up)]
    along = product(boxes.axes[:, 0], np.cross(goal.up, views).T)
    across = product(boxes.axes[:, 0], goal.up.T)
    length = np.maximum(np.hypot(along, across), np.finfo(float).tiny)
    legible[:, : len(views)] *= 1 - objective.rolled * (1 - along / length) / 2
    shown = visible * (objective.seen + (1 - objective.seen) * legible**objective.legibility)
    corners = boxes.corners() - goal.centroid
    whole = product(corners, goal.half_spaces.T).min(axis=1) > 0
    return np.concatenate([shown, whole], axis=1).astype(np.float32)
