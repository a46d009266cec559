"""Voxel remeshing (paper, section 5.4: the remesh modifier of a modelling tool)."""

import igl
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from core.arrays import Bool, Float, Int
from core.geometry.spatial import SpatialIndex
from core.lab.attacks.target import Attacked, Target, whole
from core.lab.plain import Mesh

# Winding number above which a point is inside. A single open surface has one half on both of its sides: the threshold
# is above it.
INSIDE = 0.55
HALF_THICKNESS = (
    0.9  # voxels; half the thickness of an open surface: more than half a voxel's diagonal, so that none is missed
)
SLOPE = 1.25  # bound on the field's slope: 1 along the distance, a little more where the winding number changes it
LEVELS = 5  # halvings of blocks: the search starts with 2**5 voxels a side
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])


def remesh(mesh: Mesh, target: Target, strength: float = 1 / 128) -> Attacked:
    """Replaces ``mesh`` by the zero set of its signed distance on a grid, extracted by marching cubes.

    A point is inside where the generalised winding number (Jacobson et al. 2013; fast variant of Barill et al. 2018) is
    beyond 0.55 in absolute value. So every kind of mesh works: holes are closed, self-intersections united, and open
    surfaces without an inside become 1.8 voxels thick. Solids thinner than a voxel are lost.

    Args:
        mesh: the watermarked mesh; open, non-manifold or inconsistently wound ones too.
        target: unused but for the watermarks' number.
        strength: voxel size in longest sides of the bounding box: 1/256 is low, 1/64 high.
    """
    voxel = strength * float(np.ptp(mesh.positions, axis=0).max())
    field = _Field(mesh, voxel)
    # Half a voxel off: planes of a model at round coordinates would otherwise lie exactly on grid points.
    origin = mesh.positions.min(axis=0) - 2.5 * voxel
    cells = _cells(field, origin, voxel, np.ptp(mesh.positions, axis=0) + 5 * voxel)
    span = cells.max(axis=0) + 2
    nodes, corner = np.unique(
        np.ravel_multi_index(tuple(np.moveaxis(cells[:, None] + CORNERS, 2, 0)), tuple(span)), return_inverse=True
    )
    points = origin + voxel * np.stack(np.unravel_index(nodes, tuple(span)), axis=1)
    positions, faces, _ = igl.marching_cubes(
        field.value(points, *field.nearest(points)), points, corner.reshape(-1, 8), 0.0
    )
    return whole(Mesh(positions, np.asarray(faces, dtype=np.int64)), target)


class _Field:
    """Signed distance to the solid that a mesh bounds, negative inside."""

    def __init__(self, mesh: Mesh, voxel: float) -> None:
        self._mesh = mesh
        self._index = SpatialIndex(mesh.positions, mesh.faces)
        self._is_open = self._find_open(0.01 * voxel)
        self._half = HALF_THICKNESS * voxel
        self.margin = self._half if self._is_open.any() else 0.0  # distance of the zero set from the mesh, at most

    def nearest(self, points: Float) -> tuple[Float, Int]:
        """Unsigned distance (N,) to the mesh and the nearest face (N,)."""
        distance, face, _ = self._index.closest(points)
        return distance, face

    def value(self, points: Float, distance: Float, face: Int) -> Float:
        """The field (N,) at ``points``, given their distances to the nearest faces."""
        # Where a hole is closed, far from any face, the sign changes continuously instead of by a jump.
        side = np.clip((INSIDE - self._winding(points)) / (1 - INSIDE), -1, 1)
        return np.minimum(side * distance, np.where(self._is_open[face], distance - self._half, np.inf))

    def _find_open(self, step: float) -> Bool:
        """(F,) faces with the outside on both sides; only faces of open components or with a coincident one can be."""
        faces = self._mesh.faces
        surface = self._mesh.surface()
        candidate = np.flatnonzero((_in_open_components(self._mesh) | _has_coincident(faces)) & (surface.areas > 0))
        middle = self._mesh.positions[faces[candidate]].mean(axis=1)
        normal = step * surface.normals[candidate]
        candidate = candidate[(self._winding(middle + normal) <= INSIDE) & (self._winding(middle - normal) <= INSIDE)]
        return np.isin(np.arange(len(faces)), candidate)

    def _winding(self, points: Float) -> Float:
        if len(points) == 0:
            return np.empty(0)
        winding = igl.fast_winding_number(self._mesh.positions, self._mesh.faces, np.ascontiguousarray(points))
        return np.asarray(np.abs(winding))


def _in_open_components(mesh: Mesh) -> Bool:
    """(F,) faces of the components that have an edge used more often in one direction than in the other."""
    count = len(mesh.positions)
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    used = coo_array((np.ones(len(start)), (start, end)), shape=(count, count)).tocsr()
    _, part = connected_components(used, directed=False)
    uneven = (used - used.T).tocoo()
    opened = part[uneven.row[uneven.data != 0]]
    return np.asarray(np.isin(part[mesh.faces[:, 0]], opened))


def _has_coincident(faces: Int) -> Bool:
    """(F,) faces that have a coincident one: with the same three vertices."""
    _, label, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(count[label.ravel()] > 1)


def _cells(field: _Field, origin: Float, voxel: float, extent: Float) -> Int:
    """(C, 3) voxels that the zero set may pass: blocks that it may pass are halved, others dropped."""
    side = 2**LEVELS
    counts = np.ceil(extent / (side * voxel)).astype(np.int64)
    blocks = side * np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    while True:
        centers = origin + voxel * (blocks + side / 2)
        reach = np.sqrt(3) / 2 * side * voxel
        distance, face = field.nearest(centers)
        possible = distance <= reach + field.margin
        far = np.flatnonzero(~possible)  # from the mesh, but perhaps not from where its holes are closed
        possible[far] = np.abs(field.value(centers[far], distance[far], face[far])) <= SLOPE * reach
        blocks = blocks[possible]
        if side == 1:
            return np.asarray(blocks)
        side //= 2
        blocks = (blocks[:, None] + side * CORNERS).reshape(-1, 3)
