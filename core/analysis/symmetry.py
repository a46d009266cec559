"""The vertical plane about which a surface is nearly its own mirror image, as figures, animals and vehicles are."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Bool, Float
from core.geometry.products import product

DIGITS = 9  # decimals of a plane's normal: equal on all processors


@dataclass(frozen=True)
class SymmetryOptions:
    """Values of :func:`mirror_plane`: all ours; the paper knows no symmetry.

    Attributes:
        probes: samples that are reflected.
        against: samples that they are compared with.
        turns: planes tried, evenly turned about the vertical.
        near: size-30 units from a reflected sample to the surface, at most, to count as met; limbs in a stride and
            what one hand holds do not.
        parallel: cosine between the reflected normal and that met, at least.
        apart: size-30 units between a sample and its image, at least, for the pair to tell where the plane is.
        refined: times that the best plane is fitted to such pairs, at most.
        least: share of the probes that are met, at least.
    """

    probes: int = 300
    against: int = 5000
    turns: int = 18
    near: float = 0.6
    parallel: float = 0.5
    apart: float = 1.0
    refined: int = 4
    least: float = 0.7


SYMMETRY = SymmetryOptions()


@dataclass(frozen=True, eq=False)
class MirrorPlane:
    """A plane of symmetry.

    Attributes:
        normal: (3,) unit.
        offset: of the plane's points along it, size-30 units.
    """

    normal: Float
    offset: float

    def side(self, points: Float) -> Float:
        """(N,) signed distance of ``points`` (N, 3)."""
        return np.asarray(product(points, self.normal[:, None])[:, 0] - self.offset)

    def reflect(self, points: Float) -> Float:
        """(N, 3) mirror images of ``points`` (N, 3)."""
        return np.asarray(points - 2 * self.side(points)[:, None] * self.normal)

    def reflect_directions(self, directions: Float) -> Float:
        """(N, 3) mirror images of ``directions`` (N, 3)."""
        return MirrorPlane(self.normal, 0.0).reflect(directions)


def mirror_plane(points: Float, normals: Float, options: SymmetryOptions = SYMMETRY) -> MirrorPlane | None:
    """The best vertical plane of symmetry of a surface with even samples ``points`` (N, 3) and ``normals`` (N, 3).

    Planes through the centroid are turned about the vertical; the one that maps most samples onto the surface is fitted
    to the pairs of samples and images. ``None`` where even that one maps too few: what has no left and right.
    """
    few, many = (slice(None, None, -(-len(points) // most)) for most in (options.probes, options.against))
    some, tree = points[few], cKDTree(points[many])

    def met(plane: MirrorPlane) -> tuple[Bool, Float]:
        """Probes that are met (N,), and the point (N, 3) that each meets."""
        distance, which = tree.query(plane.reflect(some))
        cosine = np.einsum("ni,ni->n", plane.reflect_directions(normals[few]), normals[many][which])
        return (distance < options.near) & (cosine > options.parallel), points[many][which]

    centroid = points.mean(axis=0)
    angles = np.arange(options.turns) * np.pi / options.turns
    turned = np.round(np.column_stack([np.cos(angles), np.zeros(len(angles)), np.sin(angles)]), DIGITS)
    planes = [MirrorPlane(normal, float((normal * centroid).sum())) for normal in turned]
    shares = [float(met(plane)[0].mean()) for plane in planes]
    share = max(shares)
    best = planes[shares.index(share)]
    for _ in range(options.refined):
        fitted = _fitted(some, *met(best), best, options)
        if fitted is None or (found := float(met(fitted)[0].mean())) <= share:
            break
        best, share = fitted, found
    return best if share >= options.least else None


def _fitted(some: Float, hit: Bool, images: Float, plane: MirrorPlane, options: SymmetryOptions) -> MirrorPlane | None:
    """The plane half-way between points ``some`` (N, 3) and those of their ``images`` (N, 3) that are ``hit`` (N,)."""
    way = some - images
    way *= np.sign(product(way, plane.normal[:, None]))
    far = hit & (np.linalg.norm(way, axis=1) > options.apart)
    total = way[far].sum(axis=0)
    if not total.any():
        return None
    normal = np.round(total / np.linalg.norm(total), DIGITS)
    normal /= np.linalg.norm(normal)
    return MirrorPlane(normal, float(np.median(product((some + images)[far] / 2, normal[:, None]))))
