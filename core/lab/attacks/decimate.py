"""Decimation by quadric error collapse (paper, supplement "More Attacks Analysis")."""

import igl
import numpy as np

from core.errors import ErrorCode, MeshmarkError
from core.lab.attacks.target import Attacked, Target, whole
from core.lab.plain import Mesh, compact


def decimate(mesh: Mesh, target: Target, strength: float = 0.9) -> Attacked:
    """Collapses edges in the order of their quadric error (Garland and Heckbert 1997; libigl's ``qslim``).

    Edges of more than two faces are cut apart first, since the collapse needs a manifold; components that met there are
    decimated on their own.

    Args:
        mesh: the watermarked mesh, open or closed.
        target: unused but for the watermarks' number.
        strength: share of the faces to remove, in (0, 1). A few more stay where every further collapse would fold
            the surface, as on models of many parts with a dozen faces each.

    Raises:
        MeshmarkError: ``no_faces`` if every face is degenerate.
    """
    corners = mesh.faces
    solid = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    if len(solid) == 0:
        raise MeshmarkError(
            ErrorCode.NO_FACES, "Every face of this file is a line or a point.", "Attack a file with a surface."
        )
    faces, source = igl.split_nonmanifold(np.ascontiguousarray(solid))
    goal = max(1, round(len(mesh.faces) * (1 - strength)))
    positions, reduced, _, _ = igl.qslim(mesh.positions[source], faces, goal)
    return whole(compact(Mesh(np.ascontiguousarray(positions), np.asarray(reduced, dtype=np.int64))), target)
