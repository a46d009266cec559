"""Faces and features: regions of the surface that no watermark should touch."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label
from scipy.spatial import cKDTree

from core.analysis.saliency import Saliency, otsu
from core.analysis.samples import Pairs, SurfaceSamples
from core.analysis.symmetry import MirrorPlane
from core.analysis.texture import TextureSaliency
from core.arrays import Bool, Float, Int
from core.geometry.products import product
from core.geometry.surface import Surface

UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class FeatureOptions:
    """Values of :func:`feature_regions`: all ours; the paper drops a mark where half of it is salient.

    Attributes:
        cell: size-30 units; salient samples in neighbouring cubes of this size are one region.
        most: share of all samples in one region, at most; a larger one, all of a fur, is split at its own threshold.
        splits: times that is done, at most.
        least: share of all samples in a region that crosses the mirror plane, at least: less are dimples.
        mirrored: size-30 units from a reflected sample to another of its kind, at most.
        symmetric: share of a region that is mirrored, at least.
        crossing: size-30 units from the mirror plane within which a region crosses it.
        reach: size-30 units from the mirror plane within which a pair belongs to the middle: eyes, not hands.
        level: of the mean of a region's normals, along the plane, at least: what looks ahead or back.
        one_way: length of this mean, at least: the tip of a tail or a horn looks in all directions.
        small: share of all samples in it, at most.
        eye: size-30 units; diagonal of the bounds of one of a pair, at most: eyes, not sleeves.
        few: samples in one of a pair, at least.
        apart: size-30 units between the two of a pair, at most.
        ahead: length of the mean of one's normals along the mirror plane, at least: rings round legs look nowhere.
        face: radius of the face about the middle of a pair, over the distance of the two.
        grow: over the root of the surface's area, how far around a region that crosses the plane belongs to it: a cheek
            between a nose and an eye.
        facing: cosine between the normals of the region and of what it grows onto, at least.
    """

    cell: float = 0.5
    most: float = 0.12
    splits: int = 3
    least: float = 0.0025
    mirrored: float = 0.8
    symmetric: float = 0.8
    crossing: float = 0.5
    reach: float = 6.0
    level: float = 0.25
    one_way: float = 0.45
    small: float = 0.025
    eye: float = 6.0
    few: int = 12
    apart: float = 6.0
    ahead: float = 0.5
    face: float = 1.0
    grow: float = 0.05
    facing: float = -0.2


FEATURES = FeatureOptions()


@dataclass(frozen=True, eq=False)
class FeatureRegions(SurfaceSamples):
    """The features of an asset, on samples of its surface.

    Attributes:
        face: (N,) the samples on a face or head.
        likely: (N,) those on other features, or on a face that only its shape tells.
    """

    face: Bool
    likely: Bool

    def under(self, boxes: Pairs) -> tuple[Float, Float]:
        """Shares (B,) of the surface inside each of B boxes that are on a ``face``, and ``likely`` on a feature."""
        values = np.column_stack([self.face, self.likely]).astype(np.float64)
        face, likely = boxes.mean(values).T
        return face, likely


def feature_regions(
    surface: Surface,
    salient: Saliency,
    texture: TextureSaliency | None,
    plane: MirrorPlane | None,
    head: Bool | None,
    options: FeatureOptions = FEATURES,
) -> FeatureRegions:
    """The features among the samples of a saliency map.

    A head that bones move is a face (:func:`core.analysis.heads.on_head`). Of figures, animals and vehicles, which have
    a left and a right (:func:`core.analysis.symmetry.mirror_plane`), regions of connected salient samples are features
    where they are symmetric and cross the mirror plane: a head, a nose and mouth, what lies between legs or under a
    tail. Fur, scales and folds are salient as well, but not symmetric, and fingers are not in the middle. Small regions
    that look ahead or back are certain, others likely. Eyes and nostrils that are painted are pairs of small symmetric
    details of the texture; the face is what lies between and round the two of a pair.

    Args:
        surface: size-30 frame.
        salient: of its shape.
        texture: of the same samples; None where the asset has one colour.
        plane: of symmetry; None where the asset has none.
        head: (N,) the samples that follow a head's bones; None where there are none.
        options: tuned values.
    """
    points, normals = salient.points, salient.normals
    face, likely = np.zeros(len(points), dtype=bool) if head is None else head, np.zeros(len(points), dtype=bool)
    if plane is not None:
        far = options.grow * float(np.sqrt(surface.areas.sum()))
        small, others = (_grown(salient, core, far, options) for core in _across(salient, plane, options))
        face, likely = face | small, others
        if texture is not None:
            face = face | _paired(texture, plane, options)
    return FeatureRegions(points, normals, face, likely)


def _across(salient: Saliency, plane: MirrorPlane, options: FeatureOptions) -> tuple[Bool, Bool]:
    """Samples in symmetric regions of salient shape that cross the plane, as far as these are near it: (N,) of small
    ones that look ahead or back, and (N,) of others."""
    number = len(salient.points)
    which, region = _parted(salient.points, salient.value, salient.salient, options)
    if not len(which):
        return np.zeros(number, dtype=bool), np.zeros(number, dtype=bool)
    points = salient.points[which]
    side, size = np.abs(plane.side(points)), np.bincount(region)
    crosses = (np.bincount(region, side <= options.crossing) > 0) & (size >= options.least * number)
    kept = crosses & (np.bincount(region, _mirrored(points, plane, options)) >= options.symmetric * size)
    look = _means(salient.normals[which], region)
    level = np.abs(product(look, np.cross(plane.normal, UP)[:, None])[:, 0])
    one_way = (level >= options.level) & (np.linalg.norm(look, axis=1) >= options.one_way)
    small = one_way & (size <= options.small * number)
    near = side <= options.reach
    return _among(which[(kept & small)[region] & near], number), _among(which[(kept & ~small)[region] & near], number)


def _paired(texture: TextureSaliency, plane: MirrorPlane, options: FeatureOptions) -> Bool:
    """(N,) samples of the faces round pairs of small symmetric details of the texture that look the same way."""
    face = np.zeros(len(texture.points), dtype=bool)
    which, region = _parted(texture.points, texture.saliency, texture.saliency > texture.threshold, options)
    if not len(which):
        return face
    points, size = texture.points[which], np.bincount(region)
    low, high = np.full((len(size), 3), np.inf), np.full((len(size), 3), -np.inf)
    np.minimum.at(low, region, points)
    np.maximum.at(high, region, points)
    center, look = _means(points, region), _means(texture.normals[which], region)
    side = plane.side(center)
    small = (np.linalg.norm(high - low, axis=1) <= options.eye) & (size >= options.few)
    ahead = np.linalg.norm(look - product(look, plane.normal[:, None]) * plane.normal, axis=1) >= options.ahead
    mirrored = np.bincount(region, _mirrored(points, plane, options)) >= options.symmetric * size
    for number in np.flatnonzero(small & ahead & mirrored & (side > 0) & (2 * side <= options.apart)):
        middle = center[number] - side[number] * plane.normal
        near = np.linalg.norm(texture.points - middle, axis=1) <= options.face * 2 * side[number]
        face |= near & (product(texture.normals, look[number][:, None])[:, 0] > 0)
    return face


def _means(rows: Float, region: Int) -> Float:
    """(R, 3) means of ``rows`` (N, 3) over each of R regions."""
    return np.column_stack([np.bincount(region, column) for column in rows.T]) / np.bincount(region)[:, None]


def _mirrored(points: Float, plane: MirrorPlane, options: FeatureOptions) -> Bool:
    """(N,) points whose mirror image is near one of the others."""
    distance, _ = cKDTree(points).query(plane.reflect(points), distance_upper_bound=options.mirrored)
    return np.asarray(np.isfinite(distance))


def _among(which: Int, number: int) -> Bool:
    """(N,) mask of a ``number`` of samples."""
    mask = np.zeros(number, dtype=bool)
    mask[which] = True
    return mask


def _parted(points: Float, value: Float, salient: Bool, options: FeatureOptions) -> tuple[Int, Int]:
    """The salient samples (S,) and the numbers (S,) of their connected regions, none of them too large: what stands
    out of an asset that is salient all over does so against its own surroundings."""
    kept = salient.copy()
    for _ in range(options.splits):
        which = np.flatnonzero(kept)
        if not len(which):
            break
        region = _regions(points[which], options.cell)
        large = np.flatnonzero(np.bincount(region) > options.most * len(points))
        if not len(large):
            return which, region
        for number in large:
            mine = which[region == number]
            kept[mine] = value[mine] > otsu(value[mine])
    which = np.flatnonzero(kept)
    return which, _regions(points[which], options.cell) if len(which) else which


def _regions(points: Float, cell: float) -> Int:
    """(N,) numbers of the connected regions of ``points`` (N, 3): those in cubes that touch are in one."""
    cube = np.floor((points - points.min(axis=0)) / cell).astype(np.int64)
    taken = np.zeros(cube.max(axis=0) + 1, dtype=bool)
    taken[tuple(cube.T)] = True
    numbers, _ = label(taken, structure=np.ones((3, 3, 3)))
    return np.asarray(numbers[tuple(cube.T)] - 1, dtype=np.int64)


def _grown(samples: SurfaceSamples, core: Bool, far: float, options: FeatureOptions) -> Bool:
    """(N,) the samples of the ``core`` (N,) and those as ``far`` from them, at most, that face the same way."""
    if not core.any():
        return core
    distance, nearest = cKDTree(samples.points[core]).query(samples.points, distance_upper_bound=far)
    near = np.flatnonzero(np.isfinite(distance))
    cosine = np.einsum("ni,ni->n", samples.normals[near], samples.normals[core][nearest[near]])
    return _among(near[cosine > options.facing], len(core))
