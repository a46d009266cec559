"""Vertex noise."""

import numpy as np

from core.lab.attacks.target import Attacked, Target, diagonal, whole
from core.lab.plain import Mesh


def noise(mesh: Mesh, target: Target, strength: float = 0.001) -> Attacked:
    """Moves every vertex along a direction of its own, drawn uniformly from the sphere, by a Gaussian distance.

    Args:
        mesh: the watermarked mesh.
        target: unused but for the watermarks' number and the random draws.
        strength: standard deviation of the distance, in diagonals of the bounding box.
    """
    direction = target.rng.normal(size=mesh.positions.shape)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = target.rng.normal(scale=strength * diagonal(mesh), size=(len(mesh.positions), 1))
    return whole(Mesh(mesh.positions + distance * direction, mesh.faces), target)
