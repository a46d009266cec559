"""What a choice of marks is worth: one number, which placement maximises.

With boxes m, chosen ones S, and columns j::

    F(S) = sum over j of w_j max over m in S of L[m, j]  -  sum over m in S of cost_m

``L[m, j]`` is how likely mark m serves column j: who looks from there reads the mark that reads best. The columns
are

* the paper's 24 views and 200 even directions, each set worth half (``w`` sums to 1 over them):
  L = seen x size x facing x roll x flatness. Seen is 1 where the mark faces the direction within 45 degrees and rays
  from all over its letters get out; size is the text's projected height over :data:`READABLE` pixels;
  facing is the cosine over that of 40 degrees; size and facing are at most 1; roll is ``1 - ROLLED (1 - cos r) / 2``
  for the angle r between the text and the picture's horizontal (1 for the even directions, whose pictures have no
  up); flatness is 1 less the bend under the text;
* 64 half-spaces through the surface's centroid, together worth :data:`CROPS`: L = 1 where the whole mark lies in the
  half-space, so that a crop by the plane leaves it.

The first sum is that of facility location, monotone and submodular: a mark that shows only what others show as well
adds nothing. Greedy choice reaches 1 - 1/e of the best (Nemhauser, Wolsey, Fisher 1978), and exchanging marks only
adds to it. A noisy-or in its place counts every mark that shows a view, which stacks them on the best places: it put
16 marks on a human figure and 12 on a cow, which are seen from as many sides with 9 and 10. ::

    cost_m = PENALTY (obstructed + 0.7 salient + sin(roll) + bend + (roughness - 1) + 0.7 detail + busy - preferred)
             + MARK + DISTORTION x (the letters' share of the surface) x relief

Obstructed is the share of the directions a mark faces in which it is not seen (what the paper's Ray punishes),
salient the share of salient surface under it, detail the share on eyes, logos or print in the texture, busy how much
colours vary there, preferred the share on regions asked for. Marks on surface that is mostly salient or detail are
barred: they are placed only where there is nothing else at all. The last two terms are what any mark costs: it has to
show more than that, and a mark that adds less is not placed. This takes the place of the paper's octants, which
spread marks without asking what they show.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.asset.polygons import hex_linear
from core.asset.surface import Surface
from core.placement.boxes import Boxes
from core.placement.candidates import upright
from core.rendering.views import fibonacci_directions, view_directions

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]
Single = NDArray[np.float32]

FACING_VIEW = np.cos(np.radians(45.0))  # a mark turned further away is not readable from that view
EVEN_DIRECTIONS = 200
HALF_SPACES = 64
CROPS = 0.1  # all half-spaces together; nearly any choice of a few marks serves nearly all
# Text 5.5 wide, the paper's, is 20 pixels high in the metrics' pictures, which show a sphere about the asset, say of
# radius 18, on 1024 pixels. Recognition reads 12 still well and 6 hardly ever.
PIXELS, READABLE, BY_SIZE = 1024 / 36, 24.0, 0.4
HEAD_ON = np.cos(np.radians(40.0))  # turned less than this a text reads as well as from the front
SEEN = 0.6
ROLLED = 0.5  # readers turn pictures in four ways; people do not
# The proportions, but for roll, are those of the prototype that kept saliency error at 0 (0.04 times obstructed share,
# 0.7 saliency, 0.6 roll, 1 less flatness), when seeing a direction counted in full and legibility not at all. Now that
# bend and roll also lessen the likelihood, half the penalty serves, with more on roll.
PENALTY, OBSTRUCTED, SALIENT, ROLL, EXPOSED, DETAIL = 0.005, 6.0, 1.4, 2.0, 1.0, 1.4
BACKUP = 0.15
MARK = 0.001  # a mark has to add about one of the 200 directions, read well
DISTORTION = 5.0  # per unit of mean distance (SMSE) that a mark adds
LETTERS = 0.41  # of a box are covered by the letters of "watermark"
LARGE_TEXT = 3.0  # WCAG 2.2, 1.4.3
TONELESS = 0.5  # gloss and edges show letters as dark as their ground
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB
BARRED = 0.45  # share salient from which no mark is placed; the metric's 0.5 less what the edges of a box hold


@dataclass(frozen=True, eq=False)
class Columns:
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
    return np.asarray(surface.areas @ middle / surface.areas.sum())


def columns(surface: Surface) -> Columns:
    """The columns for an asset."""
    (views, up), even = view_directions(), fibonacci_directions(EVEN_DIRECTIONS)
    weight = np.repeat([0.5 / len(views), 0.5 / len(even), CROPS / HALF_SPACES], [len(views), len(even), HALF_SPACES])
    return Columns(np.concatenate([views, even]), up, fibonacci_directions(HALF_SPACES), centroid(surface), weight)


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
        barred: (B,) boxes on salient parts, for use only where there is nothing else.
        weight: (J,) what serving each column is worth.
        start: a good choice among the boxes, which selection improves on.
    """

    boxes: Boxes
    loss: Float
    roughness: Float
    visible: Bool
    likelihood: NDArray[np.float32]
    cost: Float
    barred: Bool
    weight: Float
    start: tuple[int, ...] = ()

    def served(self, chosen: list[int]) -> tuple[Single, Single]:
        """(J,) each: how well the best and the second best of the ``chosen`` boxes serve each column."""
        one = np.zeros((2, self.likelihood.shape[1]), np.float32)
        best = np.partition(np.concatenate([one, self.likelihood[chosen]]), (-2, -1), axis=0)
        return best[-1], best[-2]

    def gain(self, chosen: list[list[int]]) -> Float:
        """(B, K) what adding each box to each of K choices adds to the objective."""
        weight = self.weight.astype(np.float32)
        gain = np.empty((len(self.boxes), len(chosen)))
        for column, one in enumerate(chosen):
            best, second = self.served(one)
            added = np.maximum(self.likelihood - best, 0) + BACKUP * np.maximum(
                np.minimum(self.likelihood, best) - second, 0
            )
            gain[:, column] = added @ weight
        return gain - self.cost[:, None]

    def value(self, chosen: list[int]) -> float:
        """The objective F of ``chosen``."""
        best, second = self.served(chosen)
        return float(self.weight @ (best + BACKUP * second) - self.cost[chosen].sum())


def facing(boxes: Boxes, directions: Float) -> Bool:
    """(B, D) which boxes look along each direction (D, 3) within 45 degrees."""
    return np.asarray(boxes.axes[:, 2] @ directions.T >= FACING_VIEW)


def tone(luminance: Float, color: str | None) -> Float:
    """(B,) how well letters stand out from ground of each relative ``luminance`` (B,), 0 to 1.

    The measure is WCAG 2's contrast ratio, whose 0.05 is the light that every screen adds. Letters of a ``color`` of
    their own ("#rrggbb") are told from the ground from a ratio of 3 on, as WCAG asks of large text. Letters without
    one are told by their walls, one side of which is lit half as much as the other: on black ground neither is seen.
    """
    if color is None:
        ratio = (luminance + 0.05) / (luminance / 2 + 0.05)
        contrast = (ratio - 1) / (1.05 / 0.55 - 1)
    else:
        letters = LUMINANCE @ hex_linear(color)
        ratio = (np.maximum(luminance, letters) + 0.05) / (np.minimum(luminance, letters) + 0.05)
        contrast = np.minimum((ratio - 1) / (LARGE_TEXT - 1), 1)
    return np.asarray(TONELESS + (1 - TONELESS) * contrast)


def likelihood(boxes: Boxes, visible: Bool, bend: Float, tone: Float, served: Columns) -> NDArray[np.float32]:
    """(B, J) likelihood that each box serves each column.

    Args:
        boxes: size-30 units.
        visible: (B, D) in which directions each is seen.
        bend: (B,) how much the surface under each bends, see :func:`bend`.
        tone: (B,) how well letters stand out from the ground, see :func:`tone`.
        served: the columns.
    """
    cosine = np.clip(boxes.axes[:, 2] @ served.directions.T, 0, 1)
    # The text is as high on the picture as its up is long there.
    upright_length = np.sqrt(np.clip(1 - (boxes.axes[:, 1] @ served.directions.T) ** 2, 0, 1))
    size = np.minimum(1.0, boxes.size[:, 1:2] * upright_length * (PIXELS / READABLE)) ** BY_SIZE
    shown = visible * size * np.minimum(1.0, cosine / HEAD_ON) * (np.clip(1 - bend, 0, 1) * tone)[:, None]
    # The text's right on the picture: how far along its horizontal, how far along its vertical.
    views = served.directions[: len(served.up)]
    along = boxes.axes[:, 0] @ np.cross(served.up, views).T
    across = boxes.axes[:, 0] @ served.up.T
    length = np.maximum(np.hypot(along, across), np.finfo(float).tiny)
    shown[:, : len(views)] *= 1 - ROLLED * (1 - along / length) / 2
    shown = SEEN * visible + (1 - SEEN) * shown
    corners = boxes.corners() - served.centroid
    whole = (corners @ served.half_spaces.T).min(axis=1) > 0
    return np.concatenate([shown, whole], axis=1).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Terms:
    """What is unwelcome at each of B places, all (B,), 0 where nothing is."""

    obstructed: Float
    salient: Float
    roll: Float
    bend: Float
    rough: Float
    exposed: Float
    detail: Float
    busy: Float
    preferred: Float
    distance: Float  # that a mark adds to the mean distance between the surfaces, size-30 units


def cost(terms: Terms) -> Float:
    """(B,) what a mark at each place costs, in shares of all directions."""
    unwelcome = (
        OBSTRUCTED * terms.obstructed
        + SALIENT * terms.salient
        + ROLL * terms.roll
        + terms.bend
        + terms.rough
        + EXPOSED * terms.exposed
        + DETAIL * terms.detail
        + terms.busy
        - terms.preferred
    )
    return PENALTY * unwelcome + MARK + DISTORTION * terms.distance


def obstructed(visible: Bool, faced: Bool, served: Columns) -> Float:
    """(B,) weighted share of the directions each box faces (B, D) in which it is not ``visible`` (B, D)."""
    weight = served.weight[: len(served.directions)]
    return np.asarray(1 - (visible @ weight) / np.maximum(faced @ weight, np.finfo(float).tiny))


def roll(boxes: Boxes) -> Float:
    """(B,) sine of the angle between a text's up and the asset's up as the text's plane shows it; 1 upside down."""
    level = np.einsum("bi,bi->b", boxes.axes[:, 1], upright(boxes.axes[:, 2])[:, 1])
    return np.asarray(np.sqrt(1 - np.clip(level, 0, 1) ** 2))


def bend(boxes: Boxes, height: Float) -> Float:
    """(B,) root mean square ``height`` (B, N) of the surface above the middle plane over half the box's thickness;
    at most 1."""
    return np.asarray(np.minimum(np.sqrt((height**2).mean(axis=1)) / (boxes.size[:, 2] / 2), 1.0))


def distance(boxes: Boxes, relief: float, area: float) -> Float:
    """(B,) about what each mark adds to the mean distance between the marked and the plain surface."""
    return np.asarray(LETTERS * boxes.size[:, 0] * boxes.size[:, 1] * relief / area)
