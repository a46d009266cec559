"""Random uniform scaling (paper, supplement "More Attacks Analysis")."""

import numpy as np

from core.lab.attacks.target import Attacked, Target, moved
from core.lab.plain import Mesh


def scale(mesh: Mesh, target: Target, strength: float = 10) -> Attacked:
    """Scales ``mesh`` about the frame's origin.

    Args:
        mesh: the watermarked mesh.
        target: unused but for the watermarks' number and the random draw.
        strength: the largest factor, above 1; the factor is drawn log-uniformly from [1 / strength, strength].
    """
    factor = strength ** target.rng.uniform(-1, 1)
    return moved(mesh, target, np.diag([factor, factor, factor, 1.0]))
