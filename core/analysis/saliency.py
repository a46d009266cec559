"""Multi-scale normal variance: regions curved in both principal directions, which a watermark should not cover."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from core.analysis.samples import Pairs, SurfaceSamples
from core.arrays import Float, Int
from core.geometry.sampling import sample
from core.geometry.surface import Surface

DIGITS = 6  # decimals of raw saliency, which is 0 to 1


@dataclass(frozen=True)
class SaliencyOptions:
    """Values of :func:`saliency`: all ours; the paper takes its map off the shelf, and its threshold from Otsu.

    Attributes:
        samples: of the surface's area.
        radii: size-30 units: an eye, a finger, an ear.
        cells: to a radius; neighbours are summed up in cubes of this size. With 4 it takes 1.5 times as long, and the
            map is the same but for 0.02 (root mean square, six assets).
        contrast: raw saliency; least difference between the means of salient regions and the rest: that of a ball of
            radius 6 and a plane, or a deviation of normals of 3 degrees (root mean square) in the direction of least
            variance. Less is the shape of a vase (0.06), the facets of a ball of 320 faces (0.07) or the noise of the
            samples (under 0.01); the shallow bumps of the Stanford bunny reach 0.11, other figures 0.16 and more
            (measured).
    """

    samples: int = 20_000
    radii: tuple[float, ...] = (0.4, 0.8, 1.6)
    cells: int = 2
    contrast: float = 0.1


SALIENCY = SaliencyOptions()


@dataclass(frozen=True, eq=False)
class Saliency(SurfaceSamples):
    """A saliency map on area samples of a surface.

    Attributes:
        value: (N,) float64, 0 to 1, higher is more salient.
        threshold: a point is salient where ``value`` is greater (Otsu); 1 where nothing is salient.
        face: (N,) int64, the face of the surface that each point lies on.
    """

    value: Float
    threshold: float
    face: Int

    @property
    def salient(self) -> NDArray[np.bool_]:
        """(N,) the salient points."""
        return self.value > self.threshold

    def under(self, boxes: Pairs) -> tuple[Float, Float]:
        """Mean ``value`` (B,) and share of salient points (B,) of the surface inside each of B boxes, given as
        :meth:`core.analysis.samples.SurfaceSamples.pairs_in_boxes`."""
        mean, share = boxes.mean(np.column_stack([self.value, self.salient])).T
        return mean, share


def saliency(surface: Surface, seed: int, options: SaliencyOptions = SALIENCY) -> Saliency:
    """The saliency map of a surface, on 20,000 area samples: hardly dependent on tessellation, not on winding.

    Around each sample the products n n^T of the normals n are averaged over the area samples within a radius, with
    weights 1 - (distance / radius)^2. The least eigenvalue e of this matrix says how much the normals vary in the
    direction in which they vary least. The raw map is the mean of sqrt(3 e) over three radii: 0 where all normals lie
    in one plane, so on planes, straight edges, pipes and other developable surface; close to 0 on cones and limbs;
    about 0.6 / R on a ball of radius R; 1 where the normals point everywhere. Heads, hands, feet, horns, eyes and
    corners are salient, the limbs and edges between them are not. n n^T is the same for -n, so neither inverted faces
    nor the second side of a thin sheet change it.

    The paper's Saliency Error takes the map of Nousias, Arvanitis, Lalos, Moustakas 2020 ("Mesh Saliency Detection
    Using Convolutional Neural Networks") off the shelf. Of that, this is a variant of the spectral part alone, the
    inverse norm of all three eigenvalues of the covariance of the normals of the faces around each face. The norm
    tells curved surface from plane, but not the number of directions: a thin limb is as salient as a right-angled edge
    (both 0.57 of the maximum), so whole arms, legs and fuselages were, though the paper means "the face, ears, and
    paws" (Definition 4). So errors by this map are not comparable with those that the paper reports.

    The map is scaled to 0 at its 1st percentile and 1 at its 99th, or at the mean of the salient points if that is
    more (features on less than 1% of a plain body). The threshold is Otsu's (1979), on the unscaled map. It halves a
    sphere just as well, so it only counts where the means of the two classes are at least 0.1 apart before scaling;
    otherwise nothing is salient and the threshold is 1.

    Args:
        surface: in the size-30 frame.
        seed: of the area samples; the same seed gives the same map.
        options: tuned values.

    Raises:
        MeshmarkError: ``no_faces`` when no face has any area.
    """
    points, face = sample(surface, options.samples, np.random.default_rng(seed))
    normals = surface.normals[face]
    # Eigenvalues come from LAPACK, whose last digits differ from one kind of processor to another.
    spreads = [_spread(points, normals, radius, options.cells) for radius in options.radii]
    raw = np.round(sum(spreads) / len(spreads), DIGITS)
    cut = otsu(raw)
    above = raw > cut
    low, high = np.percentile(raw, [1, 99])
    stands_out = above.any() and raw[above].mean() - raw[~above].mean() >= options.contrast
    top = max(high, raw[above].mean()) if stands_out else max(high, low + options.contrast)
    value = np.clip((raw - low) / (top - low), 0, 1)
    return Saliency(points, normals, value, float((cut - low) / (top - low)) if stands_out else 1.0, face)


def _spread(points: Float, normals: Float, radius: float, cells: int) -> Float:
    """(N,) least variation of the normals around each sample over all directions: 0 where they lie in one plane, 1
    where they point evenly in all directions."""
    moments = [normals[:, i] * normals[:, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    # Summed up in cubes, so that thin or crumpled shapes, with thousands of samples within a radius, cost no more.
    cube = np.floor((points - points.min(axis=0)) * (cells / radius)).astype(np.int64)
    extent = cube.max(axis=0) + 1
    _, owner, count = np.unique(
        (cube[:, 0] * extent[1] + cube[:, 1]) * extent[2] + cube[:, 2], return_inverse=True, return_counts=True
    )
    center = np.column_stack([np.bincount(owner, weights=column) for column in points.T]) / count[:, None]
    total = np.column_stack([*(np.bincount(owner, weights=entry) for entry in moments), count])
    pairs = cKDTree(points).sparse_distance_matrix(cKDTree(center), radius, output_type="ndarray")
    weight = coo_array((1 - (pairs["v"] / radius) ** 2, (pairs["i"], pairs["j"])), shape=(len(points), len(center)))
    around = weight @ total
    mean = around[:, :6] / around[:, 6:]
    entries = mean[:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(-1, 3, 3)
    least = np.linalg.eigvalsh(entries)[:, 0]
    return np.asarray(np.sqrt(np.clip(3 * least, 0, 1)))  # rounding may leave it a little outside


def otsu(values: Float) -> float:
    """The threshold that splits ``values`` into the two classes furthest apart (Otsu 1979), over all splits."""
    ordered = np.sort(values)
    low = np.arange(1, len(ordered))
    high = len(ordered) - low
    total = np.cumsum(ordered)
    apart = total[:-1] / low - (total[-1] - total[:-1]) / high
    split = int(np.argmax(low * high * apart**2))
    return float((ordered[split] + ordered[split + 1]) / 2)
