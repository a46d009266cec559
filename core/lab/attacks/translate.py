"""Random translation (paper, supplement "More Attacks Analysis")."""

import numpy as np

from core.lab.attacks.target import Attacked, Target, diagonal, moved
from core.lab.plain import Mesh


def translate(mesh: Mesh, target: Target, strength: float = 1) -> Attacked:
    """Moves ``mesh`` in a direction drawn uniformly from the sphere.

    Args:
        mesh: the watermarked mesh.
        target: unused but for the watermarks' number and the random draw.
        strength: distance, in diagonals of the bounding box.
    """
    direction = target.rng.normal(size=3)
    transform = np.eye(4)
    transform[:3, 3] = direction / np.linalg.norm(direction) * strength * diagonal(mesh)
    return moved(mesh, target, transform)
