"""The Laplacian of a mesh that an attacker has, however bad its triangles are."""

import igl
import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from core.arrays import Float
from core.lab.plain import Mesh

STEEPEST, TINY = 10.0, 1e-12  # cotangent, at most; area added to every vertex, so that loose ones can be solved for


def laplacian(mesh: Mesh, least: float = 0.0) -> tuple[csr_array, Float]:
    """(V, V) the Laplacian by cotangents (Pinkall and Polthier 1993), positive semidefinite, and (V,) the area that
    belongs to each vertex, size-30 units.

    Needles have no angles to speak of, and edges of three faces no Delaunay triangulation: half the cotangents are
    kept between ``least`` and 10.
    """
    count = len(mesh.positions)
    weight = np.clip(np.nan_to_num(igl.cotmatrix_entries(mesh.positions, mesh.faces)), least, STEEPEST).ravel()
    start, end = mesh.faces[:, [1, 2, 0]].ravel(), mesh.faces[:, [2, 0, 1]].ravel()
    joined = coo_array((np.tile(weight, 2), (np.append(start, end), np.append(end, start))), shape=(count, count))
    area = np.bincount(mesh.faces.ravel(), np.repeat(mesh.surface().areas / 3, 3), count).astype(np.float64) + TINY
    return csr_array(diags_array(joined.sum(axis=1)) - joined), area
