"""Fillings for the place of letters: flat polygons, a plate, or a fair surface."""

import numpy as np
from manifold3d import triangulate
from numpy.linalg import LinAlgError
from scipy.interpolate import RBFInterpolator
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from core.arrays import Bool, Float, Int
from core.geometry.edges import boundary_edges, connected, edge_table
from core.geometry.products import cross
from core.geometry.triangles import unit
from core.lab.attacks.laplacian import laplacian
from core.lab.plain import Mesh, compact

# Vertices nearest to each of a piece's rim that a plate goes through, and of these that count at a place inside.
ROUND, NEAREST = 24, 60
LEAST = 1e-3  # half a cotangent, so that every vertex hangs on its neighbours
APART, STIFF = 6, 1e-9  # decimals by which places of a plate differ; its smoothing, so that it can be solved


def grown(faces: Int, found: Bool, rings: int) -> Bool:
    """(F,) the ``found`` faces (F,) and those within so many rings of neighbours that share a vertex."""
    for _ in range(rings):
        near = np.zeros(int(faces.max(initial=-1)) + 1, dtype=bool)
        near[faces[found]] = True
        found = np.asarray(near[faces].any(axis=1))
    return found


def filled_flat(mesh: Mesh, found: Bool) -> tuple[Mesh, Int]:
    """The mesh without the ``found`` faces (F,), each hole closed by triangles between the corners of its border, as
    they lie in its mean plane; and the face that each was, -1 for new ones."""
    kept = np.flatnonzero(~found)
    touched = np.zeros(len(mesh.positions), dtype=bool)
    touched[mesh.faces[kept]] = True
    holes = [mesh.faces[piece] for piece in _pieces(mesh.faces, found)]
    closed = [_closed(mesh.positions, hole) for hole in holes if touched[hole].any()]
    fills = np.concatenate([np.empty((0, 3), dtype=np.int64), *closed])
    source = np.append(kept, np.full(len(fills), -1))
    return compact(Mesh(mesh.positions, np.concatenate([mesh.faces[kept], fills]))), source


def lowered(mesh: Mesh, found: Bool) -> Mesh:
    """The mesh with the vertices inside the ``found`` faces (F,) moved along the mean normal of their piece, onto the
    thin plate through the vertices round it (Duchon 1977). Pieces without anything round them, or with a straight
    line only, stay as they are."""
    kept = np.zeros(len(mesh.positions), dtype=bool)
    kept[mesh.faces[~found]] = True
    row = np.flatnonzero(kept)
    positions = mesh.positions.copy()
    tree = cKDTree(mesh.positions[row])
    for piece in _pieces(mesh.faces, found):
        vertices = np.unique(mesh.faces[piece])
        inside, rim = vertices[~kept[vertices]], vertices[kept[vertices]]
        normal = _mean_normal(mesh.positions, mesh.faces[piece])
        if not len(rim) or not len(inside) or not normal.any():
            continue
        plane = _plane(normal)
        round_it = mesh.positions[row[np.unique(tree.query(mesh.positions[rim], min(ROUND, len(row)))[1])]]
        # One of those above each other: a plate has one height at a place.
        _, first = np.unique(np.round(round_it @ plane, APART), axis=0, return_index=True)
        round_it = round_it[first]
        if len(round_it) < 3:
            continue
        plate = RBFInterpolator(
            round_it @ plane, round_it @ normal, neighbors=min(NEAREST, len(round_it)), smoothing=STIFF
        )
        try:
            height = plate(mesh.positions[inside] @ plane)
        except LinAlgError:  # the nearest of them lie in a line, through which there are many plates
            continue
        lift = height - mesh.positions[inside] @ normal
        positions[inside] += lift[:, None] * normal
    return Mesh(positions, mesh.faces)


def filled_fair(mesh: Mesh, found: Bool) -> Mesh:
    """The mesh with the vertices inside the ``found`` faces (F,) moved to where the Laplacian of its Laplacian is 0
    (Botsch and Kobbelt 2004): a surface that goes on from the one round it without an edge. Parts that are found whole
    stay as they are."""
    kept = np.zeros(len(mesh.positions), dtype=bool)
    kept[mesh.faces[~found]] = True
    edge = mesh.faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    part = connected(len(mesh.positions), edge[:, 0], edge[:, 1])
    inside = ~kept & (np.bincount(part, kept)[part] > 0)
    if not inside.any():
        return mesh
    matrix, area = laplacian(mesh, least=LEAST)
    twice = csr_array(matrix @ diags_array(1 / area) @ matrix)
    rows = twice[np.flatnonzero(inside)]
    pull = rows[:, np.flatnonzero(~inside)] @ mesh.positions[~inside]
    positions = mesh.positions.copy()
    positions[inside] = splu(rows[:, np.flatnonzero(inside)].tocsc()).solve(-pull)
    return Mesh(positions, mesh.faces)


def _pieces(faces: Int, found: Bool) -> list[Int]:
    """The ``found`` faces (F,) in groups that hang together by edges."""
    part = edge_table(faces).among(found).components()
    order = np.flatnonzero(found)[np.argsort(part[found], kind="stable")]
    return np.split(order, np.flatnonzero(np.diff(part[order])) + 1) if len(order) else []


def _closed(positions: Float, faces: Int) -> Int:
    """(T, 3) triangles with the border of connected ``faces``, which wind alike."""
    rings, normal = _rings(faces), _mean_normal(positions, faces)
    if not rings or not normal.any():
        return np.empty((0, 3), dtype=np.int64)
    plane = _plane(normal)
    triangles = triangulate([positions[ring] @ plane for ring in rings])
    return np.asarray(np.concatenate(rings)[triangles], dtype=np.int64)


def _mean_normal(positions: Float, faces: Int) -> Float:
    """(3,) unit normal, by area; 0 where there is none."""
    a, b, c = (positions[faces[:, corner]] for corner in range(3))
    return np.asarray(unit(cross(b - a, c - a).sum(axis=0)[None])[0])


def _plane(normal: Float) -> Float:
    """(3, 2) two directions at right angles to a ``normal`` (3,), counterclockwise round it."""
    right = unit(cross(normal, np.eye(3)[np.abs(normal).argmin()])[None])[0]
    return np.stack([right, cross(normal, right)], axis=1)


def _rings(faces: Int) -> list[Int]:
    """The closed borders of ``faces``, in the direction of their sides."""
    following: dict[int, list[int]] = {}
    for start, end in boundary_edges(faces).tolist():
        following.setdefault(start, []).append(end)
    rings: list[Int] = []
    while following:
        ring = [next(iter(following))]
        while ring[-1] in following and (len(ring) == 1 or ring[-1] != ring[0]):
            ends = following[ring[-1]]
            if len(ends) == 1:
                del following[ring[-1]]
            ring.append(ends.pop())
        if ring[-1] == ring[0] and len(ring) > 3:
            rings.append(np.array(ring[:-1], dtype=np.int64))
    return rings
