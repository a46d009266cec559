"""Crop: keep the half of the mesh on one side of a plane (paper, section 5.4)."""

import numpy as np

from core.arrays import Float, Int
from core.lab.attacks.target import Attacked, Target
from core.lab.plain import Mesh, compact


def crop(mesh: Mesh, target: Target, strength: float = 0.5) -> Attacked:
    """Cuts ``mesh`` with a plane of random direction and drops the geometry behind it.

    Triangles are cut exactly at the plane. The cut stays open: any tool can cap it afterwards, and a cap hides no
    letter.

    Args:
        mesh: the watermarked mesh.
        target: a box is kept if all its eight corners are on the remaining side.
        strength: position of the plane along its normal, in (0, 1): 0 would leave everything, 0.5 is the plane through
            the surface's centroid (by area), 1 would remove everything; linear between these.
    """
    direction = target.rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    height = mesh.positions @ direction
    middle = float(_centroid(mesh) @ direction)
    level = float(np.interp(strength, [0, 0.5, 1], [height.min(), middle, height.max()]))
    inside = np.all(target.boxes.corners() @ direction >= level, axis=1)
    return Attacked(clip(mesh, height - level), np.asarray(inside))


def clip(mesh: Mesh, height: Float) -> Mesh:
    """The part of ``mesh`` where the (V,) linear field ``height`` is not negative; neighbours share new vertices."""
    kept = height >= 0
    count = kept[mesh.faces].sum(axis=1)
    mixed = mesh.faces[(count == 1) | (count == 2)]
    # The odd corner first: the one kept of one, or the one dropped of two; the winding stays.
    odd = kept[mixed] == (kept[mixed].sum(axis=1) == 1)[:, None]
    apex, left, right = np.take_along_axis(mixed, (odd.argmax(axis=1)[:, None] + np.arange(3)) % 3, axis=1).T

    edges = np.sort(np.concatenate([np.stack([apex, left], 1), np.stack([apex, right], 1)]), axis=1)
    unique, label = np.unique(edges, axis=0, return_inverse=True)
    one, other = height[unique].T
    share = (one / (one - other))[:, None]  # opposite signs, and never both zero
    cut = (1 - share) * mesh.positions[unique[:, 0]] + share * mesh.positions[unique[:, 1]]
    first, second = (label.ravel() + len(mesh.positions)).reshape(2, -1)

    tip = kept[apex]
    faces = np.concatenate(
        [
            mesh.faces[count == 3],
            np.stack([apex, first, second], 1)[tip],
            np.stack([first, left, right], 1)[~tip],
            np.stack([first, right, second], 1)[~tip],
        ]
    )
    return compact(_without_slivers(Mesh(np.concatenate([mesh.positions, cut]), faces), unique, height))


def _without_slivers(mesh: Mesh, edges: Int, height: Float) -> Mesh:
    """A cut through a vertex makes no second vertex there, nor faces without area."""
    target = np.arange(len(mesh.positions))
    for end in range(2):
        through = np.flatnonzero(height[edges[:, end]] == 0)
        target[len(height) + through] = edges[through, end]
    faces = target[mesh.faces]
    return Mesh(mesh.positions, faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)])


def _centroid(mesh: Mesh) -> Float:
    areas = mesh.surface().areas
    return np.asarray(np.average(mesh.positions[mesh.faces].mean(axis=1), axis=0, weights=areas))
