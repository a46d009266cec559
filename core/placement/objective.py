"""What a choice of marks is worth: one number, which placement maximises.

With boxes m, chosen ones S, and columns j::

    F(S) = sum over j of w_j (first_j + BACKUP second_j)  -  sum over m in S of cost_m
           -  CROWD x sum over pairs in S of beside(m, n)

where ``first_j`` and ``second_j`` are the largest and the second largest L[m, j] over m in S, and ``L[m, j]``, 0 to
1, is how well mark m serves column j: who looks from there reads the mark that reads best, and still reads one after
somebody has filed that one off. The columns are

* the paper's 24 views and 200 even directions, each set worth half (``w`` sums to 1 over them)::

      L = seen (SEEN + (1 - SEEN) size x facing x roll x flatness)

  Seen is 1 where the mark faces the direction within 45 degrees and rays from all over its letters get out; size is
  how well text as high as this is read, coloured or not (:mod:`core.placement.legibility`), the projected height times
  its tone; tone is how letters stand out from the base colour under them, see :func:`contrast`; facing is the cosine
  over that of 40 degrees, at most 1; roll is ``1 - ROLLED (1 - cos r) / 2`` for the angle r between the text and the
  picture's horizontal (1 for the even directions, whose pictures have no up); flatness is 1 less the bend under the
  text;
* 64 half-spaces through the surface's centroid, together worth ``CROPS``: L = 1 where the whole mark lies in the
  half-space, so that a crop by the plane leaves it.

``beside`` is 1 less the distance of the centres over 5, at least 0, for marks on the same side of the surface: texts
that stand in a stack are taken off together, and look like a list.

F is submodular (the two largest of a set, the second weighing less; pairs only take away): a mark that shows only what
two others show better adds nothing. Were it monotone too, greedy choice would reach 1 - 1/e of the best (Nemhauser,
Wolsey, Fisher 1978); exchanging marks only adds to it. A noisy-or in place of the two largest counts every mark that
shows a view, which stacks them on the best places. Without the second mark (BACKUP 0) 10.7 marks on sixteen assets
were read in 0.77 of the views, with it 14.2 marks in 0.84. ::

    cost_m = PENALTY (6 obstructed + 1.4 salient + 3 sin(roll) + bend + (roughness - 1) + exposed + 40 joint
                      + 1.4 detail + busy - preferred)
             + MARK + min(DISTORTION x (the letters' share of the surface) x relief, 0.05)

Obstructed is the share of the directions a mark faces in which it is not seen (what the paper's Ray punishes),
salient the share of salient surface under it, exposed the share of a frame around it in which the surface does not go
on (edges, silhouettes, holes), joint how many joints share the skin under it (letters on an elbow are torn in other
poses), detail the share on eyes, logos or print in the texture, busy how much colours vary
there, preferred the share on regions asked for. Thin walls take no sunken letters at all
(:func:`core.placement.filters.thin_walled`), and marks do not overlap (selection). Seams of the texture cost nothing
of their own: letters carry the texture of either side, and a change of colour at a seam is what busy counts. Marks on
surface that is mostly salient, or a third of it detail, are barred: they are placed only where there is nothing else
at all. The last two terms are what any mark costs: it has to show more than that, and a mark that adds less is not
placed. This takes the place of the paper's octants, which spread marks without asking what they show.

What each term does to the metrics is in the report of ``meshmark benchmark --methods objective``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from core.analysis.texture import cielab
from core.arrays import Bool, Float, Int
from core.geometry.boxes import Boxes
from core.geometry.directions import fibonacci_directions, view_directions
from core.geometry.products import product
from core.geometry.surface import Surface
from core.gltf.colors import hex_linear
from core.placement.candidates import upright
from core.placement.legibility import legibility

Single = NDArray[np.float32]

FACING_VIEW = np.cos(np.radians(45.0))  # a mark turned further away is not readable from that view
EVEN_DIRECTIONS = 200
HALF_SPACES = 64
HEAD_ON = np.cos(np.radians(40.0))  # turned less than this a text reads as well as from the front
ROLLED = 0.5  # readers turn pictures in four ways; people do not
PENALTY = 0.005
WORTH_DIGITS = 6  # of an objective that is about 1
MOST_DISTORTED = 0.05  # whoever asks for text as large as a side gets it on all sides
PROXIMITY_RANGE = 5.0  # between the centres of marks, size-30 units
# CIELAB units between letters and ground. Over 672 views of one mark in six colours on eleven textured assets, 12 to 20
# pixels high, recognition reads 0.37 to 0.69 below 30 and 0.8 to 0.9 above; by WCAG 2's contrast ratio, which does not
# see that red on grey differs, 0.76 to 0.84 below 3 and 0.87 above.
DISTINCT = 50.0
MIN_CONTRAST = 0.5  # gloss and edges show letters as dark as their ground
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB
MAX_SALIENT_SHARE = (
    0.45  # share salient from which no mark is placed; the metric's 0.5 less what the edges of a box hold
)
MAX_DETAIL_SHARE = 0.3  # share on details of the texture likewise: an eye or a line of print is a small part of a box


@dataclass(frozen=True)
class Objective:
    """How much each term counts; see the module. Ablations set one to 0, nobody else sets any.

    The proportions come from sweeps over the survivors on 33 assets: fewer penalties leave no view without a mark, more
    on roll and saliency keeps text upright (4 degrees in the mean) and features free, and obstructed counts most
    because it is in every view's picture. With distortion at 20 SMSE is a sixth larger, and text reads no better.
    """

    seen: float = 0.5  # of serving a direction, for being seen there at all
    redundancy: float = 0.15  # of serving a column, for the second best mark
    crops: float = 0.1  # all half-spaces together; nearly any choice of a few marks serves nearly all
    legibility: float = 1.0  # exponent of size x facing x roll x flatness
    obstructed: float = 6.0
    salient: float = 1.4
    roll: float = 3.0
    curvature_deviation: float = 1.0
    rough: float = 1.0
    edge_proximity: float = 1.0
    articulation: float = 40.0  # text that joints tear is worth nothing in motion
    detail: float = 1.4
    busy: float = 1.0
    preferred: float = 1.0
    mark: float = 0.0003  # a mark has to add more than an eighth of one of the 200 directions
    proximity_weight: float = (
        0.01  # a pair of marks at one place: more than the second is worth but on the only side of its kind
    )
    distortion: float = 35.0  # per unit of mean distance (SMSE) that a mark adds
    bars: bool = True  # salient parts and details are barred


OBJECTIVE = Objective()


@dataclass(frozen=True, eq=False)
class Targets:
    """What marks are to serve.

    Attributes:
        directions: (D, 3) unit vectors from the asset towards the camera, the 24 views first.
        up: (24, 3) the pictures' up in the views.
        half_spaces: (H, 3) unit normals of planes through ``centroid``, pointing to the kept side.
        centroid: (3,) of the surface.
        weight: (D + H,) what serving each column is worth.
    """

    directions: Float
    up: Float
    half_spaces: Float
    centroid: Float
    weight: Float


def centroid(surface: Surface) -> Float:
    """(3,) of a surface with area, size-30 units."""
    middle = surface.positions[surface.faces].mean(axis=1)
    return np.asarray((surface.areas[:, None] * middle).sum(axis=0) / surface.areas.sum())


def targets(surface: Surface, objective: Objective = OBJECTIVE) -> Targets:
    """The columns for an asset."""
    (views, up), even = view_directions(), fibonacci_directions(EVEN_DIRECTIONS)
    weight = np.repeat(
        [0.5 / len(views), 0.5 / len(even), objective.crops / HALF_SPACES], [len(views), len(even), HALF_SPACES]
    )
    return Targets(np.concatenate([views, even]), up, fibonacci_directions(HALF_SPACES), centroid(surface), weight)


@dataclass(frozen=True, eq=False)
class Placement:
    """All boxes that survived the filters, and what choosing among them needs.

    Attributes:
        boxes: B boxes, size-30 units.
        loss: (B,) mean squared distance of the outline to the surface, squared size-30 units.
        roughness: (B,) mean of 1/cos between normals; 1 is flat.
        visible: (B, D) whether the box faces a direction within 45 degrees and all its rays get out.
        likelihood: (B, J) float32 that the box serves each column, 0 to 1.
        cost: (B,) in the unit of ``weight``.
        last_resort: (B,) boxes on salient parts, for use only where there is nothing else.
        weight: (J,) what serving each column is worth.
        redundancy: what serving it a second time is worth of that.
        proximity_weight: what a pair of boxes costs that stand right beside each other.
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
    redundancy: float = OBJECTIVE.redundancy
    proximity_weight: float = OBJECTIVE.proximity_weight
    start: tuple[int, ...] = ()

    def coverage(self, chosen: Sequence[int]) -> tuple[Single, Single]:
        """(J,) each: how well the best and the second best of the ``chosen`` boxes serve each column."""
        (best, second, _), _ = self._leaders(chosen)
        return best, second

    def gain(self, chosen: Sequence[int]) -> Float:
        """(B,) what adding each box to the ``chosen`` adds to the objective."""
        best, second = self.coverage(chosen)
        added = (self._added(best, second) * self.weight).sum(axis=1)
        return _even(added - self.proximity_weight * self.proximity(chosen).sum(axis=1) - self.cost)

    def gain_without(self, chosen: Sequence[int]) -> Float:
        """(B, K) :meth:`gain` where each of the K ``chosen`` boxes in turn is left out.

        Only in those columns does that make a difference in which the one left out is best or second best.
        """
        (best, second, third), owner = self._leaders(chosen)
        whole = self._added(best, second) * self.weight
        gain = np.repeat(whole.sum(axis=1)[:, None], len(chosen), axis=1)
        for rank, (one, other) in enumerate([(second, third), (best, third)]):
            without = self._added(one, other) * self.weight - whole
            for number in range(len(chosen)):
                gain[:, number] += without[:, owner[rank] == number].sum(axis=1)
        near = self.proximity(chosen)
        return _even(gain - self.proximity_weight * (near.sum(axis=1, keepdims=True) - near) - self.cost[:, None])

    def _leaders(self, chosen: Sequence[int]) -> tuple[Single, Int]:
        """(3, J) the three largest likelihoods of the ``chosen`` boxes in each column, 0 where there are fewer, and
        (2, J) which of ``chosen`` has the largest and the second largest; -1 for none."""
        none = np.zeros((3, self.likelihood.shape[1]), np.float32)
        rows = np.concatenate([self.likelihood[list(chosen)], none])
        order = np.argsort(-rows, axis=0, kind="stable")[:3]
        return np.take_along_axis(rows, order, axis=0), np.where(order < len(chosen), order, -1)[:2]

    def _added(self, best: Single, second: Single) -> Single:
        """(B, J) what each box adds in each column where others serve it ``best`` and ``second`` best (J,)."""
        backed = np.minimum(self.likelihood, best)
        backed -= second
        np.maximum(backed, 0, out=backed)
        backed *= self.redundancy
        added = self.likelihood - best
        np.maximum(added, 0, out=added)
        added += backed
        return added

    def proximity(self, chosen: Sequence[int]) -> Float:
        """(B, K) how much each box stands beside each of the K ``chosen``: 1 less the distance over
        :data:`PROXIMITY_RANGE` on the same side of the surface, 0 for itself."""
        chosen = list(chosen)
        apart = cdist(self.boxes.center, self.boxes.center[chosen])
        same_side = product(self.boxes.axes[:, 2], self.boxes.axes[chosen, 2].T) > 0
        near = np.maximum(1 - apart / PROXIMITY_RANGE, 0) * same_side
        near[chosen, np.arange(len(chosen))] = 0
        return np.asarray(near)

    def value(self, chosen: Sequence[int]) -> float:
        """The objective F of ``chosen``."""
        best, second = self.coverage(chosen)
        crowded = self.proximity_weight * self.proximity(chosen)[list(chosen)].sum() / 2
        served = (self.weight * (best + self.redundancy * second)).sum()
        return float(_even(served - self.cost[list(chosen)].sum() - crowded))


def _even(worth: Float) -> Float:
    """``worth`` without its last digits, which may differ from one machine to another: what is as good as equal is
    equal, and the first of equals is chosen."""
    return np.asarray(np.round(worth, WORTH_DIGITS))


def facing(boxes: Boxes, directions: Float) -> Bool:
    """(B, D) which boxes look along each direction (D, 3) within 45 degrees."""
    return np.asarray(product(boxes.axes[:, 2], directions.T) >= FACING_VIEW)


def contrast(ground: Float, color: str | None) -> Float:
    """(B,) how well letters stand out from each colour of the ``ground`` (B, 3), linear sRGB: 0 to 1.

    Letters of a ``color`` of their own ("#rrggbb") are told from the ground by the distance of the two in CIELAB.
    Letters without one are told by their walls, one side of which is lit half as much as the other: on black ground
    neither is seen. The measure is WCAG 2's contrast ratio, whose 0.05 is the light that every screen adds.
    """
    if color is None:
        luminance = product(ground, LUMINANCE[:, None])[:, 0]
        ratio = (luminance + 0.05) / (luminance / 2 + 0.05)
        contrast = (ratio - 1) / (1.05 / 0.55 - 1)
    else:
        apart = np.linalg.norm(cielab(ground) - cielab(hex_linear(color)[None]), axis=1)
        contrast = np.minimum(apart / DISTINCT, 1)
    return np.asarray(MIN_CONTRAST + (1 - MIN_CONTRAST) * contrast)


def best_possible_coverage(height: float, cosine: Float, color: str | None, objective: Objective = OBJECTIVE) -> Float:
    """(D,) how well a mark serves directions at best, whose text is of a ``height`` in size-30 units and turned away
    by the angles of these ``cosine`` (D,)."""
    legible = legibility(np.array(height), color) * np.clip(cosine / HEAD_ON, 0, 1)
    return np.asarray(objective.seen + (1 - objective.seen) * legible)


def likelihood(
    boxes: Boxes,
    visible: Bool,
    bend: Float,
    tone: Float,
    served: Targets,
    color: str | None = None,
    objective: Objective = OBJECTIVE,
) -> Single:
    """(B, J) likelihood that each box serves each column.

    Args:
        boxes: size-30 units.
        visible: (B, D) in which directions each is seen.
        bend: (B,) how much the surface under each bends, see :func:`curvature_deviation`.
        tone: (B,) how well letters stand out from the ground, see :func:`contrast`.
        served: the columns.
        color: of the letters, "#rrggbb"; None for that of the ground.
        objective: the terms' weights.
    """
    cosine = np.clip(product(boxes.axes[:, 2], served.directions.T), 0, 1)
    # The text is as high on the picture as its up is long there.
    upright_length = np.sqrt(np.clip(1 - product(boxes.axes[:, 1], served.directions.T) ** 2, 0, 1))
    # Contrast and size stand in for each other: fainter text has to be larger.
    height = boxes.size[:, 1:2] * upright_length * tone[:, None]
    legible = legibility(height, color) * np.minimum(1.0, cosine / HEAD_ON) * np.clip(1 - bend, 0, 1)[:, None]
    # The text's right on the picture: how far along its horizontal, how far along its vertical.
    views = served.directions[: len(served.up)]
    along = product(boxes.axes[:, 0], np.cross(served.up, views).T)
    across = product(boxes.axes[:, 0], served.up.T)
    length = np.maximum(np.hypot(along, across), np.finfo(float).tiny)
    legible[:, : len(views)] *= 1 - ROLLED * (1 - along / length) / 2
    shown = visible * (objective.seen + (1 - objective.seen) * legible**objective.legibility)
    corners = boxes.corners() - served.centroid
    whole = product(corners, served.half_spaces.T).min(axis=1) > 0
    return np.concatenate([shown, whole], axis=1).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Terms:
    """What is unwelcome at each of B places, all (B,), 0 where nothing is."""

    obstructed: Float
    salient: Float
    roll: Float
    curvature_deviation: Float
    rough: Float
    edge_proximity: Float
    articulation: Float
    detail: Float
    busy: Float
    preferred: Float
    distance: Float  # that a mark adds to the mean distance between the surfaces, size-30 units


def cost(terms: Terms, objective: Objective = OBJECTIVE) -> Float:
    """(B,) what a mark at each place costs, in shares of all directions."""
    unwelcome = (
        objective.obstructed * terms.obstructed
        + objective.salient * terms.salient
        + objective.roll * terms.roll
        + objective.curvature_deviation * terms.curvature_deviation
        + objective.rough * terms.rough
        + objective.edge_proximity * terms.edge_proximity
        + objective.articulation * terms.articulation
        + objective.detail * terms.detail
        + objective.busy * terms.busy
        - objective.preferred * terms.preferred
    )
    return PENALTY * unwelcome + objective.mark + np.minimum(objective.distortion * terms.distance, MOST_DISTORTED)


def obstructed(visible: Bool, faced: Bool, served: Targets) -> Float:
    """(B,) weighted share of the directions each box faces (B, D) in which it is not ``visible`` (B, D)."""
    weight = served.weight[: len(served.directions)]
    return np.asarray(
        1 - (visible * weight).sum(axis=1) / np.maximum((faced * weight).sum(axis=1), np.finfo(float).tiny)
    )


def roll(boxes: Boxes) -> Float:
    """(B,) sine of the angle between a text's up and the asset's up as the text's plane shows it; 1 upside down."""
    level = np.einsum("bi,bi->b", boxes.axes[:, 1], upright(boxes.axes[:, 2])[:, 1])
    return np.asarray(np.sqrt(1 - np.clip(level, 0, 1) ** 2))


def curvature_deviation(boxes: Boxes, height: Float) -> Float:
    """(B,) root mean square ``height`` (B, N) of the surface above the middle plane over half the box's thickness;
    at most 1."""
    return np.asarray(np.minimum(np.sqrt((height**2).mean(axis=1)) / (boxes.size[:, 2] / 2), 1.0))


def distance(boxes: Boxes, relief: Float, ink: float, area: float) -> Float:
    """(B,) about what each mark, its letters ``relief`` (B,) high and covering the share ``ink`` of its box, adds to
    the mean distance between the marked and the plain surface of an ``area``."""
    return np.asarray(ink * boxes.size[:, 0] * boxes.size[:, 1] * relief / area)
