"""Random rotation (paper, supplement "More Attacks Analysis")."""

import numpy as np
from scipy.spatial.transform import Rotation

from core.lab.attacks.target import Attacked, Target, moved
from core.lab.plain import Mesh


def rotate(mesh: Mesh, target: Target, strength: float = 180) -> Attacked:
    """Turns ``mesh`` about the frame's origin, around an axis drawn uniformly from the sphere.

    Args:
        mesh: the watermarked mesh.
        target: unused but for the watermarks' number and the random draw.
        strength: the largest angle in degrees, in (0, 180]; the angle is drawn uniformly from [0, strength].
    """
    axis = target.rng.normal(size=3)
    angle = np.radians(target.rng.uniform(0, strength))
    transform = np.eye(4)
    transform[:3, :3] = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
    return moved(mesh, target, transform)
