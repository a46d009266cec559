"""Mesh saliency of Lee, Varshney, Jacobs 2005: a published map beside our own, for the Saliency Error."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

from core.analysis.saliency import Saliency, otsu
from core.arrays import Float, Int
from core.geometry.products import cross
from core.geometry.sampling import sample
from core.geometry.surface import Surface

BLOCK = 500_000  # faces or edges at a time: what bounds the memory
GOLDEN = (0.7548776662466927, 0.5698402909980532)  # steps of Roberts's R2 sequence, which fills a square evenly


@dataclass(frozen=True)
class MeshSaliencyOptions:
    """Values of :func:`mesh_saliency`: scales, reach and suppression are Lee et al.'s, the rest is ours.

    Attributes:
        samples: of the surface's area, at which the map is had; they have it at vertices.
        unit: the length epsilon, of the diagonal of the bounding box (theirs).
        scales: deviations of the centres' Gaussians, epsilons (theirs); those of the surrounds are twice as large.
        reach: deviations up to which a Gaussian is summed up (theirs).
        cells: of the grid to a deviation.
        parts: into which the curvature of long edges, and the area of large faces, is spread at least.
        around: nearest samples among which a local maximum is the greatest; they look at neighbouring vertices.
    """

    samples: int = 20_000
    unit: float = 0.003
    scales: tuple[float, ...] = (2.0, 3.0, 4.0, 5.0, 6.0)
    reach: float = 2.0
    cells: float = 1.5
    parts: int = 200_000
    around: int = 8


MESH_SALIENCY = MeshSaliencyOptions()


@dataclass(frozen=True, eq=False)
class _Lumps:
    """Mean curvature and area of a surface, summed up in cubes.

    Attributes:
        center: (N, 3) of the cubes.
        curvature: (N,) integral of the mean curvature in each.
        area: (N,) of the surface in each.
    """

    center: Float
    curvature: Float
    area: Float


def mesh_saliency(surface: Surface, seed: int, options: MeshSaliencyOptions = MESH_SALIENCY) -> Saliency:
    """The saliency map of Lee, Varshney, Jacobs ("Mesh Saliency", ACM Transactions on Graphics 24, 2005).

    With G(v, s) the mean curvature averaged about v with Gaussian weights of deviation s, cut off at 2 s, the saliency
    at scale s is ``|G(v, s) - G(v, 2 s)|``, for s of 2 to 6 epsilons of 0.3% of the bounding box's diagonal. Each
    scale is normalised to 1 and multiplied by ``(1 - m)^2``, m the mean of its local maxima without the greatest
    (their non-linear suppression: one peak counts, many alike do not); the map is the sum over scales. It is written
    from that description. Otsu's threshold splits it, as the watermarking paper splits its map; unlike for ours
    (:func:`core.analysis.saliency.saliency`) no least contrast is asked for, so on a ball noise is halved.

    They weight vertices, all alike, with Taubin's curvatures, so that tessellation decides; here averages are over
    area, and the curvature is the discrete one of polyhedra: half the angle between its faces times the length of each
    edge of two faces. Edges of one, three or more faces have none.

    The time is bounded: one pass over faces and edges, in blocks, sums both up in cubes; all else depends on the
    20,000 samples and on the grid, of at most 3 million cubes (their side is 0.4% of the diagonal, which is at least
    sqrt 3 times the cube root of the bounding box's volume).

    Args:
        surface: in the size-30 frame.
        seed: of the area samples; the same seed gives the same map.
        options: scales and bounds.

    Raises:
        MeshmarkError: ``no_faces`` when no face has any area.
    """
    points, face = sample(surface, options.samples, np.random.default_rng(seed))
    used = surface.positions[np.unique(surface.faces)]
    low, extent = used.min(axis=0), np.ptp(used, axis=0)
    unit = options.unit * float(np.linalg.norm(extent))
    lumps = _lumps(surface, low, unit * options.scales[0] / options.cells, options.parts)
    averages = {
        scale: _average(lumps, points, low, scale * unit, options)
        for scale in sorted({*options.scales, *(2 * scale for scale in options.scales)})
    }
    _, near = cKDTree(points).query(points, k=min(options.around + 1, len(points)))
    # Beyond that, sums of so many numbers are noise.
    maps = [np.asarray(np.abs(averages[scale] - averages[2 * scale])).round(9) for scale in options.scales]
    value = np.sum([_suppressed(one, near) for one in maps], axis=0)
    if value.max() > 0:
        value /= value.max()
    return Saliency(points, surface.normals[face], value, otsu(value) if value.max() > value.min() else 1.0, face)


def _suppressed(value: Float, near: Int) -> Float:
    """(N,) the saliency at one scale, normalised, and less where many local maxima are about equal; ``near`` (N, K) are
    each sample and those around it."""
    if value.max() <= 0:
        return value
    value = value / value.max()
    peaks = value[(value >= value[near].max(axis=1)) & (value > 0) & (value < 1)]
    return np.asarray(value * (1 - (peaks.mean() if len(peaks) else 0)) ** 2)


def _average(lumps: _Lumps, points: Float, low: Float, deviation: float, options: MeshSaliencyOptions) -> Float:
    """(N,) the mean curvature about each of ``points`` (N, 3), with Gaussian weights of this deviation."""
    cell = deviation / options.cells
    margin = int(np.ceil(options.reach * options.cells)) + 1  # what lies beyond the bounds is empty, not mirrored
    where = np.floor((lumps.center - low) / cell).astype(np.int64) + margin
    shape = tuple((where.max(axis=0) + margin + 1).tolist())
    flat = np.ravel_multi_index(tuple(where.T), shape)
    place = ((points - low) / cell + margin - 0.5).T
    curvature, area = (
        map_coordinates(
            gaussian_filter(
                np.bincount(flat, weights=mass, minlength=int(np.prod(shape))).astype(np.float32).reshape(shape),
                options.cells,
                mode="constant",
                truncate=options.reach,
            ),
            place,
            output=np.float64,
            order=1,
            mode="nearest",
        )
        for mass in (lumps.curvature, lumps.area)
    )
    return np.asarray(np.divide(curvature, area, out=np.zeros(len(points)), where=area > 0))


def _lumps(surface: Surface, low: Float, cell: float, parts: int) -> _Lumps:
    """Curvature and area in cubes with sides of ``cell``, the first of which begins at ``low``."""
    shape = np.floor(np.ptp(surface.positions[np.unique(surface.faces)], axis=0) / cell).astype(np.int64) + 1
    count = int(shape.prod())
    area, curvature = np.zeros(count), np.zeros(count)
    for total, spread in ((area, _areas(surface, parts)), (curvature, _curvatures(surface, parts))):
        for points, mass in spread:
            where = np.clip(np.floor((points - low) / cell).astype(np.int64), 0, shape - 1)
            total += np.bincount((where[:, 0] * shape[1] + where[:, 1]) * shape[2] + where[:, 2], mass, count)
    kept = np.flatnonzero((area > 0) | (curvature != 0))
    center = low + (np.column_stack(np.unravel_index(kept, tuple(shape.tolist()))) + 0.5) * cell
    return _Lumps(center, curvature[kept], area[kept])


def _areas(surface: Surface, parts: int) -> Iterator[tuple[Float, Float]]:
    """Points (N, 3) on the faces, more on larger ones, and the area (N,) that each stands for; block by block."""
    fair = surface.areas.sum() / parts
    for first in range(0, len(surface.faces), BLOCK):
        areas = surface.areas[first : first + BLOCK]
        face, number, share = _divided(areas, fair)
        a, b, c = (surface.positions[surface.faces[first + face, corner]] for corner in range(3))
        u, v = (np.mod(0.5 + step * number, 1.0)[:, None] for step in GOLDEN)
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        single = share[:, None] == areas[face][:, None]
        u, v = np.where(single, 1 / 3, u), np.where(single, 1 / 3, v)
        yield a + u * (b - a) + v * (c - a), share


def _curvatures(surface: Surface, parts: int) -> Iterator[tuple[Float, Float]]:
    """Points (N, 3) along the edges of two faces, more on those that are longer and sharper, and the integral (N,) of
    mean curvature that each stands for: positive on convex edges; block by block."""
    one, other, consistent = surface.edges.pairs()
    corners = surface.faces.ravel()

    def ends(side: Int) -> tuple[Float, Float]:
        following = side + np.where(side % 3 == 2, -2, 1)
        return surface.positions[corners[side]], surface.positions[corners[following]]

    def bent(rows: slice) -> Float:
        start, end = ends(one[rows])
        normal = surface.normals[one[rows] // 3]
        across = surface.normals[other[rows] // 3] * np.where(consistent[rows], 1.0, -1.0)[:, None]
        turn = np.einsum("ei,ei->e", cross(normal, across), end - start)  # sine of the angle, times the length
        length = np.linalg.norm(end - start, axis=1)
        # Without area a face has no normal, and an edge to it no angle.
        return np.asarray(np.arctan2(turn, np.einsum("ei,ei->e", normal, across) * length) * length / 2)

    blocks = [slice(first, first + BLOCK) for first in range(0, len(one), BLOCK)]
    masses = [bent(rows) for rows in blocks]
    fair = sum(float(np.abs(mass).sum()) for mass in masses) / parts
    for rows, mass in zip(blocks, masses, strict=True):
        edge, number, share = _divided(mass, fair)
        start, end = ends(one[rows][edge])
        into = np.bincount(edge, minlength=len(mass))[edge]
        yield start + ((number + 0.5) / into)[:, None] * (end - start), share


def _divided(mass: Float, fair: float) -> tuple[Int, Int, Float]:
    """Equal parts, at most ``fair`` each, of each of ``mass`` (N,): whose each is (P,), its number among them (P,), and
    how much it has (P,)."""
    count = np.ceil(np.abs(mass) / fair).astype(np.int64) if fair > 0 else np.zeros(len(mass), dtype=np.int64)
    owner = np.repeat(np.arange(len(mass)), count)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    return owner, number, mass[owner] / count[owner]
