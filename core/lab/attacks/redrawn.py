"""The file that a thief is left with: his mesh in the materials of the file that he attacked."""

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from core.arrays import Bool, Float, Int
from core.geometry.edges import edge_table
from core.gltf.accessors import read_values
from core.gltf.builder import Builder
from core.gltf.scene import Scene, flatten
from core.lab.plain import Mesh

WIDTHS = {"TEXCOORD_0": 2, "TEXCOORD_1": 2, "COLOR_0": 4}  # numbers a vertex has of what is carried over
FREE = 1e-9  # pull towards 0 of values that hang on nothing, so that they can be solved for


def redrawn(file: Scene, mesh: Mesh, source: Int) -> Scene:
    """``mesh`` in the materials, UVs and vertex colours of ``file``, without normals, nodes and motion.

    Args:
        file: the marked asset.
        mesh: what an attack made of its faces.
        source: (F,) the face of ``file`` that each face of ``mesh`` was; -1 for new ones, which get the material most
            used round their patch, and UVs and colours that are harmonic between those at its rim.
    """
    drawn = file.primitives
    primitive, values = _before(file)
    number, corners = primitive[source], {name: rows[source] for name, rows in values.items()}
    new = source < 0
    if new.any():
        patch = edge_table(mesh.faces).among(new).components()
        number[new] = _round(mesh.faces, new, patch, number)
        for rows in corners.values():
            rows[new] = _harmonic(mesh.faces, new, patch, number, rows)
    builder = Builder(file.document)
    for name in ("meshes", "nodes", "skins", "animations", "cameras"):
        builder.json.pop(name, None)
    primitives = []
    for one in np.unique(number):
        faces, first = np.flatnonzero(number == one), drawn[one].primitive
        positions = mesh.positions[mesh.faces[faces].ravel()].astype(np.float32)
        attributes = {"POSITION": builder.add_accessor(positions, "VEC3", bounded=True)}
        for name in sorted(WIDTHS.keys() & first.attributes.keys()):
            rows = corners[name][faces].reshape(-1, WIDTHS[name]).astype(np.float32)
            attributes[name] = builder.add_accessor(rows, f"VEC{WIDTHS[name]}")
        material = {} if first.material.index is None else {"material": first.material.index}
        primitives.append({"attributes": attributes, **material})
    builder.append("meshes", {"primitives": primitives})
    builder.append("nodes", {"mesh": 0})
    builder.json |= {"scene": 0, "scenes": [{"nodes": [0]}]}
    return flatten(builder.to_document())


def _before(file: Scene) -> tuple[Int, dict[str, Float]]:
    """(F,) the primitive of each face, and (F, 3, n) the values at its corners of all that :data:`WIDTHS` names; ones
    where it has none."""
    surface = file.surface
    values = {name: np.ones((len(surface.faces), 3, width)) for name, width in WIDTHS.items()}
    for number, one in enumerate(file.primitives):
        mine = surface.face_primitive == number
        triangles = one.triangles[surface.face_triangle[mine]][:, [0, 2, 1] if one.mirrored else [0, 1, 2]]
        for name in WIDTHS.keys() & one.primitive.attributes.keys():
            rows = read_values(file.document, one.primitive.attributes[name])
            values[name][mine, :, : rows.shape[1]] = rows[triangles]
    return surface.face_primitive.copy(), values


def _round(faces: Int, new: Bool, patch: Int, number: Int) -> Int:
    """The primitive of each ``new`` face: the one of most old faces at its patch's vertices, else of most of all."""
    old = np.flatnonzero(~new)
    common = np.bincount(number[old]).argmax() if len(old) else 0
    count, kinds = int(faces.max()) + 1, int(number[old].max(initial=0)) + 1
    corner = csr_array((np.ones(3 * len(old)), (faces[old].ravel(), np.repeat(number[old], 3))), shape=(count, kinds))
    labels, mine = np.unique(patch[new], return_inverse=True)
    touch = np.unique(np.stack([np.repeat(mine, 3), faces[new].ravel()]), axis=1)
    votes = csr_array((np.ones(touch.shape[1]), (touch[0], touch[1])), shape=(len(labels), count)) @ corner
    dense = votes.toarray()
    return np.asarray(np.where(dense.any(axis=1), dense.argmax(axis=1), common)[mine])


def _harmonic(faces: Int, new: Bool, patch: Int, number: Int, values: Float) -> Float:
    """(N, 3, n) at the corners of the ``new`` faces: the mean over old corners of the same primitive at the vertices
    that have some, and harmonic between these, patch by patch."""
    # A vertex of each primitive and patch of its own.
    count = int(faces.max()) + 1
    _, place = np.unique((patch[new][:, None] * count + faces[new]).ravel(), return_inverse=True)
    place = place.reshape(-1, 3)
    vertex, kind = np.empty(place.max() + 1, dtype=np.int64), np.empty(place.max() + 1, dtype=np.int64)
    vertex[place], kind[place] = faces[new], number[new][:, None]
    kinds = int(number.max()) + 1
    key = (faces[~new] * kinds + number[~new][:, None]).ravel()
    found, row = np.unique(key, return_inverse=True)
    total = np.zeros((len(found), values.shape[2]))
    np.add.at(total, row, values[~new].reshape(len(key), -1))
    total /= np.bincount(row)[:, None]
    at = np.minimum(np.searchsorted(found, vertex * kinds + kind), len(found) - 1)
    known = found[at] == vertex * kinds + kind
    result = np.where(known[:, None], total[at], 1.0)
    start, end = place[:, [0, 1, 2]].ravel(), place[:, [1, 2, 0]].ravel()
    joined = coo_array(
        (np.ones(2 * len(start)), (np.append(start, end), np.append(end, start))), shape=(len(vertex),) * 2
    ).tocsr()
    matrix = csr_array(diags_array(joined.sum(axis=1) + FREE) - joined)[np.flatnonzero(~known)]
    if len(matrix.indptr) > 1:
        pull = matrix[:, np.flatnonzero(known)] @ result[known]
        result[~known] = splu(matrix[:, np.flatnonzero(~known)].tocsc()).solve(-pull)
    return np.asarray(result[place])
