"""The smooth profile of letters: a height field that rises out of the surface, with a shallow trench round each letter.

The letters' mask, blurred, is a slope without an edge at its foot or at its top; a wider blur taken away from it is the
trench, which keeps the ground dark round bright letters and the other way about.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from manifold3d import CrossSection, JoinType
from scipy.ndimage import distance_transform_edt, gaussian_filter

from core.arrays import Bool, Float, Int
from core.artwork.artwork import SOFT_REACH
from core.artwork.raster import filled
from core.embossing.rings import Rings

MAX_TEXELS = 1_000_000  # of a field: an eighth of a second
FINER = 4  # texels of the letters' mask for each of the field, along and across
ROUNDS = 5  # of bisecting the sides of contours, at most


@dataclass(frozen=True)
class ProfileOptions:
    """Values of :func:`height_field`: all ours; the paper's letters have vertical walls and flat tops.

    Attributes:
        slope: deviation of the Gaussian weights that the letters' mask is blurred with, in mean stroke widths. OCR of
            uncoloured letters on clay, mean of five assets: 0.87 at 0.27, 0.93 at 0.2; 0.92 of flat letters.
        trench: that of the wider weights, in mean stroke widths.
        rise: factor of the first blur.
        sink: factor of the second one, which is taken away.
        reach: mean stroke widths round the letters in which the field is eased to 0.
        texel: of the field, in deviations of the slope.
        contours: of the letters along which the field is sampled, in deviations of the slope; positive ones are inside.
        coarse: the simplification of contours, in deviations of the slope.
        bend: heights by which the field may deviate from a straight side of a contour.
        shortest: side of a contour, in deviations of the slope, that is not bisected.
    """

    slope: float = 0.2
    trench: float = 0.9
    rise: float = 1.3
    sink: float = 0.6
    reach: float = SOFT_REACH
    texel: float = 0.25
    contours: tuple[float, ...] = (1.3, -1.2, -2.4)
    coarse: float = 0.25
    bend: float = 0.05
    shortest: float = 2.0


PROFILE = ProfileOptions()


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights of letters and of the ground round them over the box plane; all lengths in text widths.

    Attributes:
        heights: (H, W), 1 near the middle of a usual stroke, less than 0 in the trench; the first row at the bottom.
        covered: (H, W) bool, texels of the footprint and those within a deviation of the slope beside it.
        origin: (2,) the middle of the first texel.
        texel: side of a texel.
        stroke: mean width of the letters' strokes.
        slope: deviation of their slope.
        reach: of the footprint round them.
        letters: the shapes.
        outlines: (N, 2) rings of the letters.
        contours: (N, 2) further rings along which a triangulation should sample the field.
    """

    heights: Float
    covered: Bool
    origin: Float
    texel: float
    stroke: float
    slope: float
    reach: float
    letters: CrossSection
    outlines: tuple[Float, ...]
    contours: tuple[Float, ...]

    @cached_property
    def covered_before(self) -> Int:
        """(H + 1, W + 1) number of covered texels in the rows and columns before each."""
        return np.asarray(np.pad(self.covered.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))))

    @cached_property
    def _with_slopes(self) -> Float:
        """(H, W, 3) the heights, and their change to the right and up."""
        up, right = np.gradient(self.heights, self.texel)
        return np.stack([self.heights, right, up], axis=-1)

    def at(self, points: Float) -> Float:
        """(N,) heights at (N, 2) points."""
        return self._sampled(self.heights, points)

    def with_gradient(self, points: Float) -> tuple[Float, Float]:
        """(N,) heights at (N, 2) points, and (N, 2) their change a text width."""
        values = self._sampled(self._with_slopes, points)
        return values[:, 0], values[:, 1:]

    def covers(self, points: Float) -> Bool:
        """(N,) bool, points (N, 2) in the footprint or close beside it."""
        column, row = np.round((points - self.origin) / self.texel).astype(np.int64).T
        high, wide = self.covered.shape
        within = (column >= 0) & (column < wide) & (row >= 0) & (row < high)
        return np.asarray(within & self.covered[np.clip(row, 0, high - 1), np.clip(column, 0, wide - 1)])

    def near(self, edges: Float) -> Float:
        """Those of the edges (E, 2, 2) whose bounds meet the field's."""
        high = self.origin + self.texel * (np.array(self.heights.shape)[::-1] - 1)
        return np.asarray(edges[((edges.max(axis=1) >= self.origin) & (edges.min(axis=1) <= high)).all(axis=1)])

    def _sampled(self, values: Float, points: Float) -> Float:
        """(N, ...) values of a raster (H, W, ...) at (N, 2) points, linear between the middles of texels, 0 beyond."""
        high, wide = values.shape[:2]
        x, y = ((points - self.origin) / self.texel).T
        within = (x >= 0) & (x <= wide - 1) & (y >= 0) & (y <= high - 1)
        left, low = (np.clip(np.floor(at), 0, most - 2).astype(np.int64) for at, most in ((x, wide), (y, high)))
        across, up = x - left, y - low
        total = np.zeros((len(points), *values.shape[2:]))
        texels, beside = values.reshape(high * wide, *values.shape[2:]), (-1,) + (1,) * (values.ndim - 2)
        for row, of_row in ((0, 1 - up), (1, up)):
            for column, of_column in ((0, 1 - across), (1, across)):
                texel = texels.take((low + row) * wide + left + column, axis=0)
                total += texel * of_row.reshape(beside) * of_column.reshape(beside)
        total[~within] = 0.0
        return total


def height_field(letters: CrossSection, stroke: float | None = None, options: ProfileOptions = PROFILE) -> HeightField:
    """The field of ``letters`` (text widths), whose strokes have the mean width ``stroke``: their own if None."""
    outlines = letters.to_polygons()
    if stroke is None:
        perimeter = sum(float(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum()) for ring in outlines)
        stroke = 2 * letters.area() / perimeter
    slope, reach = options.slope * stroke, options.reach * stroke
    left, bottom, right, top = letters.bounds()
    room = reach + 2 * slope
    low, high = np.array([left, bottom]) - room, np.array([right, top]) + room
    texel = max(options.texel * slope, float(np.sqrt(np.prod(high - low) / MAX_TEXELS)))
    columns, rows = (np.ceil((high - low) / texel).astype(np.int64) + 1).tolist()
    fine = filled(outlines, low - texel / 2, FINER / texel, (columns * FINER, rows * FINER))
    mask = _shares(fine, FINER)
    near, wide = (gaussian_filter(mask, width * stroke / texel) for width in (options.slope, options.trench))
    beside = distance_transform_edt(mask < 0.5) * texel
    heights = (options.rise * near - options.sink * wide) * eased(2 * (1 - beside / reach))
    field = HeightField(heights, beside <= reach + slope, low, texel, stroke, slope, reach, letters, (), ())
    tolerance = options.coarse * slope
    around = [_offset(letters, at * -slope, slope).simplify(tolerance) for at in options.contours]
    around.append(_offset(letters, reach, slope).simplify(2 * tolerance))
    contours = [ring for section in around for ring in section.to_polygons()]
    rings = _bisected(Rings.of([*outlines, *contours]), field, options).separate()
    return replace(field, outlines=tuple(rings[: len(outlines)]), contours=tuple(rings[len(outlines) :]))


def _shares(mask: Bool, side: int) -> Float:
    """(H, W) shares of the squares of ``side`` by ``side`` texels of a mask (H side, W side) that it covers."""
    high, wide = mask.shape
    by_row = mask.view(np.uint8).reshape(high // side, side, wide).sum(axis=1, dtype=np.uint8)
    count = sum(by_row[:, column::side] for column in range(side))
    return np.asarray(count / side**2)


def eased(share: Float) -> Float:
    """0 up to 0, 1 from 1 on, and smooth between them."""
    share = np.clip(share, 0.0, 1.0)
    return np.asarray(share * share * (3 - 2 * share))


def _offset(letters: CrossSection, by: float, slope: float) -> CrossSection:
    """The shapes moved outwards, their corners rounded with about a side for each deviation of the slope."""
    sides = 4 * max(2, int(np.ceil(np.pi / 2 * abs(by) / slope)))
    return letters.offset(by, JoinType.Round, 2.0, min(sides, 32))


def _bisected(rings: Rings, field: HeightField, options: ProfileOptions) -> Rings:
    """The ``rings`` with their sides bisected until the field is about linear along each."""
    height = field.at(rings.points)
    unknown = np.ones(len(height), dtype=bool)
    for _ in range(ROUNDS):
        ahead = rings.ahead
        which = np.flatnonzero(unknown & rings.longer(options.shortest * field.slope))
        start, way = rings.points[which], rings.points[ahead[which]] - rings.points[which]
        first, last = height[which], height[ahead[which]]
        error = [np.abs(field.at(start + share * way) - first - share * (last - first)) for share in (0.25, 0.5, 0.75)]
        split = which[np.max(error, axis=0) > options.bend]
        if not len(split):
            break
        middle = (rings.points[split] + rings.points[ahead[split]]) / 2
        rings, height = rings.with_points(split, middle), np.insert(height, split + 1, field.at(middle))
        new = split + np.arange(len(split))  # of each pair of halves the first
        unknown = np.zeros(len(height), dtype=bool)
        unknown[new] = unknown[new + 1] = True
    return rings
