"""An asset as one solid, as booleans with the whole mesh need it."""

import numpy as np
from manifold3d import Error, Manifold, Mesh64

from core.arrays import Int
from core.errors import ErrorCode, MeshmarkError
from core.geometry.edges import directed_edges
from core.geometry.surface import MODEL_SIZE, Surface
from core.lab.plain import Mesh, plain

NEAR = 1e-6 * MODEL_SIZE  # size-30 units; closer vertices were one before they were rounded to 32 bits
MENDED = 0.001  # share of an asset's area that may be added to close it, at most


def solid(surface: Surface) -> Manifold:
    """``surface`` as a closed, oriented 2-manifold, size-30 units.

    First the mesh as it is, then with near vertices merged, then with its small defects closed: loops of edges that
    lack a partner get a fan of triangles, as long as all of them add less than a thousandth of the area. An asset
    that is inside out as a whole is flipped. (manifold3d's own ``merge`` is not used: building from its result for an
    open mesh can end the process.)

    Raises:
        MeshmarkError: ``not_manifold``.
    """
    mesh = plain(surface)
    for attempt in (_proper, _near_merged, _mended):
        mesh = attempt(mesh)
        body = to_manifold(mesh)
        if body.status() == Error.NoError and not body.is_empty():
            return body if body.volume() > 0 else to_manifold(Mesh(mesh.positions, mesh.faces[:, ::-1]))
    raise MeshmarkError(
        ErrorCode.NOT_MANIFOLD,
        f"This asset is not a closed solid: {int(_excess(mesh.faces).sum())} of its edges have no partner on the other "
        "side.",
        "Close its holes and make its winding consistent, or use a method that does not need solids.",
    )


def to_manifold(mesh: Mesh) -> Manifold:
    """``mesh`` for manifold3d in double precision; its status shows if it is a manifold."""
    return Manifold(Mesh64(np.ascontiguousarray(mesh.positions), np.ascontiguousarray(mesh.faces.astype(np.uint64))))


def to_mesh(body: Manifold) -> Mesh:
    """A manifold3d solid as a plain mesh."""
    found = body.to_mesh64()
    return Mesh(np.array(found.vert_properties[:, :3]), np.array(found.tri_verts, dtype=np.int64))


def _proper(mesh: Mesh) -> Mesh:
    """``mesh`` without the faces that have two equal corners."""
    a, b, c = mesh.faces.T
    return Mesh(mesh.positions, mesh.faces[(a != b) & (b != c) & (c != a)])


def _near_merged(mesh: Mesh) -> Mesh:
    _, first, label = np.unique(np.round(mesh.positions / NEAR), axis=0, return_index=True, return_inverse=True)
    return _proper(Mesh(mesh.positions[first], label.reshape(-1)[mesh.faces]))


def _excess(faces: Int) -> Int:
    """(E,) for each distinct directed edge, see ``np.unique``, the number of faces along it less those against it."""
    edges = directed_edges(faces)
    edge, count = np.unique(edges, axis=0, return_counts=True)
    size = int(faces.max(initial=0)) + 1
    key, back = edge[:, 0] * size + edge[:, 1], edge[:, 1] * size + edge[:, 0]
    at = np.minimum(np.searchsorted(key, back), len(key) - 1)
    return np.asarray(np.maximum(count - np.where(key[at] == back, count[at], 0), 0), dtype=np.int64)


def _mended(mesh: Mesh) -> Mesh:
    """``mesh`` with a fan for every loop of edges that lack a partner; unchanged where the fans would be large.

    Faces enter and leave each vertex equally often, so the edges in excess always form loops.
    """
    edge = np.unique(directed_edges(mesh.faces), axis=0)
    lonely = np.repeat(edge, _excess(mesh.faces), axis=0)
    positions, faces = [mesh.positions], [mesh.faces]
    number = len(mesh.positions)
    for loop in _loops(lonely):
        corner = mesh.positions[loop]
        following = np.roll(loop, -1)
        positions.append(corner.mean(axis=0, keepdims=True))
        faces.append(np.stack([following, loop, np.full(len(loop), number)], axis=1))
        number += 1
    mended = Mesh(np.concatenate(positions), np.concatenate(faces))
    area = mended.surface().areas
    return mended if area[len(mesh.faces) :].sum() <= MENDED * area.sum() else mesh


def _loops(edges: Int) -> list[Int]:
    """Directed ``edges`` (E, 2), which enter each vertex as often as they leave it, as loops of vertices."""
    leaving: dict[int, list[int]] = {}
    for start, end in edges.tolist():
        leaving.setdefault(start, []).append(end)
    loops = []
    for start in leaving:
        path = [start]
        while leaving[path[-1]] or len(path) > 1:
            path.append(leaving[path[-1]].pop())
            if path[-1] in path[:-1]:  # cut off as soon as it closes, so that loops stay small
                first = path.index(path[-1])
                loops.append(np.array(path[first:-1], dtype=np.int64))
                del path[first + 1 :]
    return loops
