"""Saliency of an asset's base colour: details (eyes, faces, logos, print) that a watermark should not cover."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from core.analysis.color import base_color
from core.analysis.saliency import otsu
from core.analysis.samples import Pairs, SurfaceSamples
from core.arrays import Float, Int
from core.geometry.surface import Surface
from core.gltf.colors import cielab
from core.gltf.scene import Scene


@dataclass(frozen=True)
class TextureOptions:
    """Values of :func:`texture_saliency`: all ours; the paper looks at no texture.

    Attributes:
        radius: size-30 units: an eye, a line of print, about the height of a watermark's letters.
        neighbours: samples at most; there are more within the radius only on assets of little area.
        parallel: cosine between the normals of neighbours, at least: the two sides of a cape are not one picture.
        tilt: tangent between a sample's plane and its neighbours, at most: nor are a cape and the back below it.
        busiest: CIELAB units of standard deviation that count as 1: half of the surface black, half grey (L* 60).
        contrast: of ``busiest``; least difference between the variation of details and of the rest: less is shading,
            grain or the noise of the samples.
        factor: least ratio between these, likewise.
        rare: share of the surface that can be salient, at most.
    """

    radius: float = 1.0
    neighbours: int = 32
    parallel: float = 0.5
    tilt: float = 0.35
    busiest: float = 30.0
    contrast: float = 0.25
    factor: float = 2.0
    rare: float = 0.25


TEXTURE = TextureOptions()


@dataclass(frozen=True, eq=False)
class TextureSaliency(SurfaceSamples):
    """The detail of an asset's base colour, on samples of its surface.

    Attributes:
        saliency: (N,) float64, 0 to 1: variation of the colours around a sample beyond the asset's usual one. 0
            everywhere where no region exceeds it.
        color_variance: (N,) float64, 0 to 1: variation of these colours. Letters without a colour of their own are
            illegible where it is high.
        color: (N, 3) float64, linear sRGB 0 to 1, the base colour at each sample.
        threshold: a sample belongs to a detail where ``saliency`` is greater; 1 where nothing is salient.
    """

    saliency: Float
    color_variance: Float
    color: Float
    threshold: float

    def under(self, boxes: Pairs) -> tuple[Float, Float, Float]:
        """Mean ``saliency`` (B,), share of samples above the threshold (B,) and mean ``color_variance`` (B,) of the
        surface inside each of B boxes, given as :meth:`core.analysis.samples.SurfaceSamples.pairs_in_boxes`."""
        values = np.column_stack([self.saliency, self.saliency > self.threshold, self.color_variance])
        mean, share, busy = boxes.mean(values).T
        return mean, share, busy

    def color_under(self, boxes: Pairs) -> Float:
        """(B, 3) mean ``color`` of the surface inside each of B boxes."""
        return boxes.mean(self.color)


def texture_saliency(
    scene: Scene, surface: Surface, points: Float, face: Int, options: TextureOptions = TEXTURE
) -> TextureSaliency | None:
    """The :class:`TextureSaliency` of an asset's base colour at ``points`` (N, 3), spread evenly over its surface.

    Around each sample the spread of colour, the root mean square distance from the mean in CIELAB, is taken over its
    nearest samples within one size-30 unit on the same side of the surface, nearer ones weighing more; so neither UV
    layout nor tessellation matters, and noise finer than the samples counts in full. The mean of these spreads over
    the same neighbours tells a region full of detail from the plain border of a large patch. Otsu's threshold (1979)
    separates details from the rest, once more among the details while these are more than a quarter of the surface;
    they count where they exceed the asset's own texture. (Centre-surround differences of colour, as of Itti, Koch,
    Niebur 1998, were tried: they find parts of an eye, and the middles of plain patches just as well.)

    Args:
        scene: the asset.
        surface: the scene's, in which faces may be wound the other way round.
        points: size-30 frame; the samples of :func:`core.analysis.saliency.saliency` will do.
        face: (N,) the face of ``surface`` that each point lies on.
        options: tuned values.

    Returns:
        ``None`` where the asset has one colour everywhere.

    Raises:
        MeshmarkError: as :func:`core.analysis.color.base_color`.
    """
    linear = base_color(scene, surface, points, face)
    if np.allclose(linear, linear[0]):
        return None
    normals = surface.normals[face]
    busy, around = _busy(points, normals, cielab(linear), options)
    stands_out, threshold = _standing_out(around, options)
    return TextureSaliency(points, normals, stands_out, busy, np.minimum(linear, 1), threshold)


def _busy(points: Float, normals: Float, lab: Float, options: TextureOptions) -> tuple[Float, Float]:
    """(N,) the spread of colour around each sample, 0 to 1 at ``busiest``, and (N,) its mean around each sample."""
    number = np.arange(len(points))
    most = min(options.neighbours, len(points))
    distance, near = cKDTree(points).query(points, k=most, distance_upper_bound=options.radius)
    found = near < len(points)
    near, distance = np.where(found, near, 0), np.where(found, distance, 0)
    # Single precision: these are half a million rows.
    position, normal, color = (values.astype(np.float32) for values in (points, normals, lab))
    height = np.abs(np.einsum("nki,ni->nk", position[near] - position[:, None], normal))
    same_side = np.einsum("nki,ni->nk", normal[near], normal) > options.parallel
    same_sheet = same_side & (height <= options.tilt * distance)
    counts = found & (same_sheet | (near == number[:, None]))
    weight = np.where(counts, (1 - (distance / options.radius) ** 2) ** 2, 0).astype(np.float32)
    weight /= weight.sum(axis=1, keepdims=True)
    offset = color[near] - np.einsum("nk,nki->ni", weight, color[near])[:, None]
    spread = np.sqrt(np.einsum("nk,nki,nki->n", weight, offset, offset))
    busy = np.minimum(spread / options.busiest, 1).astype(np.float64)
    return busy, np.einsum("nk,nk->n", weight, busy[near])


def _standing_out(busy: Float, options: TextureOptions) -> tuple[Float, float]:
    """(N,) saliency, 0 at the mean of the usual values to 1 at that of the large ones, and the threshold between these
    on that scale."""
    cut = otsu(busy)
    while (busy > cut).mean() > options.rare:
        cut = otsu(busy[busy > cut])
    above = busy > cut
    if not above.any():
        return np.zeros(len(busy)), 1.0
    low, high = busy[~above].mean(), busy[above].mean()
    if high < max(low + options.contrast, low * options.factor):
        return np.zeros(len(busy)), 1.0
    return np.clip((busy - low) / (high - low), 0, 1), float((cut - low) / (high - low))
