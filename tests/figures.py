"""The manual's pictures of what metrics measure: drawn by the product itself, from the demo asset.

What a metric looks at is drawn by rays, with the same index of the surface that the metric has.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.spatial import cKDTree

from core.analysis.saliency import Saliency
from core.arrays import Float
from core.geometry.boxes import Boxes
from core.geometry.directions import EYE_DISTANCE, fibonacci_directions, view_directions
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.triangles import unit
from core.metrics import match
from core.metrics.coverage import DIRECTIONS
from core.metrics.measure import Pair, measure
from core.metrics.prominence import STANDS_OUT
from core.metrics.ray_origins import above_letters
from core.parameters import parse_parameters
from core.pipeline import watermark
from core.placement.objective import centroid
from core.placement.selection import visibility
from tests.manual import ROOT
from tests.tiles import SUPERSAMPLING, TILE, row, tile

ASSET = ROOT / "tests" / "data" / "spot.glb"
SIDE, UP = np.array([0.85, 0.3, -0.5]), np.array([0.0, 1.0, 0.0])
SAMPLES = TILE * SUPERSAMPLING // 2 * 2
PAPER = (235, 235, 235)
CLAY, MARKED, LOST = (196, 198, 204), (208, 32, 32), (140, 146, 160)
HEAT = np.array([[225, 226, 230], [253, 208, 120], [235, 110, 50], [150, 10, 40]], dtype=float)
RED = "#d02020"
STRIP = 90  # pixels; height of a picture of one mark


@dataclass(frozen=True, eq=False)
class View:
    """What a camera sees of a surface.

    Attributes:
        met: (S, S) where there is surface.
        points: (N, 3) of it, in the order of the pixels.
        light: (N,) share of the light that comes back from it.
    """

    met: NDArray[np.bool_]
    points: Float
    light: Float

    def painted(self, colors: Any) -> Image.Image:
        """The picture, with the colours (N, 3) or one colour."""
        shown = np.full((*self.met.shape, 3), PAPER, dtype=np.uint8)
        shown[self.met] = np.clip(np.asarray(colors) * self.light[:, None], 0, 255)
        return tile(shown)


def seen(index: SpatialIndex, middle: Float, radius: float, direction: Float = SIDE, up: Float = UP) -> View:
    """A sphere of a surface, seen by parallel rays from a ``direction``."""
    backward = unit(direction[None])[0]
    right = unit(np.cross(up, backward)[None])[0]
    steps = radius * ((np.arange(SAMPLES) + 0.5) / SAMPLES * 2 - 1)
    across, down = np.meshgrid(steps, -steps)
    screen = middle + across[..., None] * right + down[..., None] * np.cross(backward, right)
    origins = (screen + EYE_DISTANCE * backward).reshape(-1, 3)
    distance, face = index.first_hit(origins, np.broadcast_to(-backward, origins.shape), Eye.ORIGIN)
    met = face >= 0
    points = origins[met] - distance[met, None] * backward
    lamp = unit((backward + 0.5 * right + 0.6 * up)[None])[0]
    light = 0.45 + 0.6 * np.abs(index.normals(face[met]) @ lamp)
    return View(met.reshape(SAMPLES, SAMPLES), points, light)


def heat(values: Float) -> Float:
    """(N, 3) colours of values from 0 to 1."""
    scale = np.linspace(0, 1, len(HEAT))
    return np.stack([np.interp(values, scale, channel) for channel in HEAT.T], axis=1)


def measured(**asked: Any) -> tuple[Pair, dict[str, Any]]:
    """What was measured of the demo asset, and the report."""
    pairs: list[Pair] = []

    def recorded(pair: Pair, *others: Any) -> Any:
        pairs.append(pair)
        return measure(pair, *others)

    with patch("core.metrics.measure.measure", recorded):
        parameters = parse_parameters({"text": "watermark", "color": RED, "strength": "strong"} | asked)
        report = watermark(ASSET.read_bytes(), parameters, preview=False).report
    return pairs[0], report["metrics"]


def whole(pair: Pair, *, marked: bool, direction: Float = SIDE) -> View:
    """The asset, by default from the side from which the manual shows it."""
    surface = pair.original.surface
    shown = surface.positions[np.unique(surface.faces)]
    middle = (shown.min(axis=0) + shown.max(axis=0)) / 2
    return seen((pair.watermarked if marked else pair.original).index, middle, 0.86 * surface.radius, direction)


def inside(boxes: Boxes, points: Float) -> NDArray[np.int64]:
    """(N,) number of the box that each point lies in, or -1."""
    owner, which, _ = boxes.contained(cKDTree(points))
    found = np.full(len(points), -1)
    found[which] = owner
    return found


def colored(where: NDArray[np.bool_], color: tuple[int, int, int] = MARKED, other: tuple[int, int, int] = CLAY) -> Any:
    return np.where(where[:, None], color, other)


def placement() -> bytes:
    """Ground in the boxes, letters in a view, and one crop."""
    pair, found = measured(evaluate="geometry")
    quality, boxes = found["watermark_quality"], pair.boxes
    before, after = whole(pair, marked=False), whole(pair, marked=True)
    ground = before.painted(colored(inside(boxes, before.points) >= 0, (70, 140, 90)))
    raised = replace(boxes, size=boxes.size + 2 * np.abs(pair.relief)[:, None] * (0, 0, 1))
    owner = inside(raised, after.points)
    apart = pair.original.index.closest(after.points)[0]
    letters = (owner >= 0) & (apart > STANDS_OUT * np.abs(pair.relief[owner]))
    cuts = fibonacci_directions(DIRECTIONS)
    cut = cuts[int(np.argmax(cuts @ np.cross(SIDE, UP)))]
    middle = centroid(pair.original.surface)
    left = ((boxes.corners() - middle) @ cut >= 0).all(axis=1)
    kept = (after.points - middle) @ cut >= 0
    marks = np.where(letters & np.append(left, False)[owner], 1, np.where(kept, 0, 2))
    return row(
        [
            (f"wps_area: {quality['wps_area']:.2f}", ground),
            (f"prominence: {quality['prominence']:.2f}", after.painted(colored(letters))),
            (f"crop_survival: {quality['crop_survival']:.2f}", after.painted(np.array([CLAY, MARKED, LOST])[marks])),
        ]
    )


def coverage() -> bytes:
    """The directions from which a mark is seen, for few marks and for many: the sphere in an equal-area map."""
    tiles = []
    for count in (2, 8, 24):
        pair, found = measured(evaluate="geometry", count=count)
        letters = above_letters(pair.original.surface, pair.original.index, pair.boxes, pair.relief)
        directions = fibonacci_directions(DIRECTIONS)
        marks = visibility(pair.boxes, letters, pair.watermarked.index, directions).sum(axis=0)
        share = found["watermark_quality"]["coverage"]
        tiles.append((f"count: {count}, coverage: {share:.2f}", sphere(directions, marks)))
    return row(tiles, lossless=True)


def sphere(directions: Float, marks: NDArray[np.int64]) -> Image.Image:
    """A dot for each direction in a disc: in its middle +Z, on its rim -Z (Lambert's equal-area projection)."""
    side = TILE * SUPERSAMPLING
    shown = Image.new("RGB", (side, side), PAPER)
    pen = ImageDraw.Draw(shown)
    radius, dot = 0.47 * side, 0.026 * side
    pen.ellipse((side / 2 - radius, side / 2 - radius, side / 2 + radius, side / 2 + radius), (250, 250, 250))
    x, y, z = directions.T
    scale = 0.44 * side / np.sqrt(2 * np.maximum(1 + z, 1e-9))
    for across, up, count in zip((x * scale).tolist(), (y * scale).tolist(), marks.tolist(), strict=True):
        color = tuple(map(int, heat(np.array([0.35 + 0.2 * min(count, 4)]))[0])) if count else (205, 207, 212)
        left, top = side / 2 + across, side / 2 - up
        pen.ellipse((left - dot, top - dot, left + dot, top + dot), color)
    return shown.reduce(SUPERSAMPLING)


def match_picture() -> bytes:
    """A mark's artwork, and the heights that rays find over its box: with the mark, and without."""
    pair, found = measured(evaluate="geometry", color="none")
    layouts = pair.require_layouts("")
    number = int(np.argmax(pair.boxes.size[:, 0]))
    one = pair.boxes[np.array([number])]
    pattern = match._pattern(layouts.artworks[int(layouts.of(one.size)[0])], match.MATCH)
    tiles = [("the artwork", _relief(pattern.relief))]
    for name, side in (("what rays find", pair.watermarked), ("before", pair.original)):
        height, met = match._heights(one, pattern, side.index, match.MATCH)
        relief = match._relief(height / pair.relief[number], met, match.MATCH.ground * pattern.stroke)
        tiles.append((name, _relief(relief)))
    value = found["watermark_quality"]["match"]
    tiles[1] = (f"what rays find, match: {value:.2f}", tiles[1][1])
    return row(tiles, height=STRIP)


def _relief(heights: Float) -> Image.Image:
    """Heights from -1 to 1 as greys, the first row at the bottom."""
    grey = Image.fromarray(np.clip(128 + 120 * heights[::-1], 0, 255).astype(np.uint8)).convert("RGB")
    grey.thumbnail((TILE, STRIP))
    shown = Image.new("RGB", (TILE, STRIP), PAPER)
    shown.paste(grey, ((TILE - grey.width) // 2, (STRIP - grey.height) // 2))
    return shown


def ocr() -> bytes:
    """Views that are read well and badly."""
    pair, found = measured(evaluate="full", strength="standard")
    scores = np.array([view["ocr"] for view in found["views"]])
    chosen = [int(np.argmin(np.abs(scores - wanted))) for wanted in (1, 0.75, 0)]
    return row(
        [
            (f"read: {scores[view]:.2f}", Image.fromarray(pair.watermarked.views.compared[view]).resize((TILE, TILE)))
            for view in chosen
        ]
    )


def difference() -> bytes:
    """The asset before and after, and how far each point of the surface is off the original."""
    pair, found = measured(evaluate="full")
    utility, view = found["asset_utility"], 15  # from the side
    after = whole(pair, marked=True, direction=view_directions()[0][view])
    apart = pair.original.index.closest(after.points)[0]
    sides = (pair.original.views, pair.watermarked.views)
    pictures = [Image.fromarray(side.compared[view]).resize((TILE, TILE)) for side in sides]
    most = float(np.abs(pair.relief).max())
    return row(
        [
            ("before", pictures[0]),
            (f"after, ss: {utility['ss']:.3f}", pictures[1]),
            (f"0 to {most:.2f} u, smse: {utility['smse']:.4f}", after.painted(heat(apart / most))),
        ]
    )


def lce() -> bytes:
    """Heights of a mark's letters over the original, flat and soft."""
    tiles = []
    for profile in ("flat", "soft"):
        pair, found = measured(evaluate="geometry", profile=profile, color="none")
        number = int(np.argmax(pair.boxes.size[:, 0]))
        box = pair.boxes[np.array([number])]
        axes = box.axes[0]
        near = seen(pair.watermarked.index, box.center[0], 0.56 * float(box.size[0, 0]), axes[2], axes[1])
        apart = pair.original.index.closest(near.points)[0]
        value = found["asset_utility"]["lce"]
        tiles.append((f"{profile}, lce: {value:.5f}", near.painted(heat(apart / float(pair.relief[number])))))
    return row(tiles)


def se() -> bytes:
    """Both maps of the original: what is above the threshold is salient."""
    pair, found = measured(evaluate="geometry")
    before = whole(pair, marked=False)
    marks = inside(pair.boxes, before.points) >= 0

    def mapped(name: str, saliency: Saliency) -> tuple[str, Image.Image]:
        _, near = cKDTree(saliency.points).query(before.points)
        colors = np.where(saliency.salient[near][:, None], (240, 150, 50), CLAY)
        colors[marks] = colors[marks] * 0.3 + np.array((30, 60, 160)) * 0.7
        return f"{name}: {found['asset_utility'][name]:.2f}", before.painted(colors)

    return row([mapped("se", pair.original.saliency), mapped("se_lee2005", pair.original.published)])


FIGURES: dict[str, Callable[[], bytes]] = {
    "metric-placement": placement,
    "metric-coverage": coverage,
    "metric-match": match_picture,
    "metric-ocr": ocr,
    "metric-difference": difference,
    "metric-lce": lce,
    "metric-saliency": se,
}
