"""Detection of letters by a thief who has only the marked file."""

import igl
import numpy as np
from scipy.sparse import diags_array
from scipy.sparse.linalg import splu

from core.arrays import Bool, Float, Int
from core.geometry.edges import connected, edge_table
from core.geometry.spatial import SpatialIndex
from core.geometry.triangles import unit
from core.gltf.accessors import read_accessor, read_values
from core.gltf.references import accessor_references
from core.gltf.scene import Scene
from core.lab.attacks.laplacian import laplacian
from core.lab.plain import Mesh

SHARP = np.cos(np.radians(35.0))  # edges turned by more are taken for those of letters
SMALL = 1e-3  # share of the asset's area that a letter's top or wall has at most
RARE = 0.1  # share of the area that all letters of one kind have at most
SAME, DIGITS = 1e-6, 5  # between corners of one colour, or at one place of a texture; and of decimals compared
TRIED = 64  # starts of what may have been appended, at most: a mesh in good order has one at every triangle
SEVERAL = 5  # letters look like this many separate pieces at least
# Size-30 units: features narrower than the first are smoothed away to find what stands out of the rest by more than
# the second; a word is not longer than the third.
FINE, STANDS_OUT, LONG = 0.2, 0.01, 7.0


def looks(scene: Scene) -> Int:
    """(F,) a number for the material of each face and, where these are the same at its three corners, for its vertex
    colour and for the place of the base colour's texture that it shows."""
    found = np.zeros((len(scene.surface.faces), 6))
    for number, drawn in enumerate(scene.primitives):
        material, attributes = drawn.primitive.material, drawn.primitive.attributes
        mine = scene.surface.face_primitive == number
        found[mine, 0] = -1 if material.index is None else material.index
        uv = None if material.texture is None else attributes.get(f"TEXCOORD_{material.uv_set}")
        for accessor, first, count in ((attributes.get("COLOR_0"), 1, 3), (uv, 4, 2)):
            if accessor is not None:
                corners = read_values(scene.document, accessor)[drawn.triangles][..., :count]
                even = np.ptp(corners, axis=1).max(axis=1) <= SAME
                found[mine, first : first + count] = np.where(even[:, None], corners[:, 0].round(DIGITS), -1)
    return np.asarray(np.unique(found, axis=0, return_inverse=True)[1].reshape(-1))


def by_material(scene: Scene, mesh: Mesh) -> Bool:
    """(F,) faces of materials, vertex colours and single texels that cover little of the asset, in several pieces."""
    look, areas = looks(scene), mesh.surface().areas
    one, other, _ = edge_table(mesh.faces).pairs()
    joined = look[one // 3] == look[other // 3]
    piece = connected(len(mesh.faces), one[joined] // 3, other[joined] // 3)
    pieces = np.bincount(look[np.unique(piece, return_index=True)[1]], minlength=look.max() + 1)
    rare = np.bincount(look, areas) < RARE * areas.sum()
    return np.asarray((rare & (pieces >= SEVERAL))[look])


def by_order(scene: Scene, mesh: Mesh) -> Bool:
    """(F,) the last triangles of each primitive, where they alone use its last vertices and cover little, in several
    pieces: what a tool appended."""
    areas, found, edges = mesh.surface().areas, np.zeros(len(mesh.faces), dtype=bool), edge_table(mesh.faces)
    for number in range(len(scene.primitives)):
        mine = np.flatnonzero(scene.surface.face_primitive == number)
        highest = scene.primitives[number].triangles[scene.surface.face_triangle[mine]].max(axis=1)
        before = np.maximum.accumulate(highest)
        after = np.minimum.accumulate(highest[::-1])[::-1]
        rest = areas[mine][::-1].cumsum()[::-1]
        starts = np.flatnonzero((before[:-1] < after[1:]) & (rest[1:] < RARE * areas.sum())) + 1
        for first in starts[:: len(starts) // TRIED + 1].tolist():
            last = np.zeros(len(mesh.faces), dtype=bool)
            last[mine[first:]] = True
            if len(np.unique(edges.among(last).components()[last])) >= SEVERAL:
                found |= last
                break
    return found


def by_remains(scene: Scene, mesh: Mesh) -> Bool:
    """(F,) faces nearest to what the file holds but does not draw: vertices that no triangle uses, of accessors in use
    and of others."""
    document = scene.document
    used = {owner[key] for owner, key in accessor_references(document.json)}
    dead = []
    for number, accessor in enumerate(document.json.get("accessors", [])):
        if number not in used and accessor.get("type") == "VEC3" and accessor.get("componentType") == 5126:
            dead.append(read_accessor(document, number).astype(np.float64))
    drawn = np.zeros(len(scene.surface.positions), dtype=bool)
    drawn[scene.surface.faces] = True
    framed = [(values - scene.surface.offset) * scene.surface.scale for values in dead]
    remains = np.concatenate([scene.surface.positions[~drawn], *framed])
    found = np.zeros(len(mesh.faces), dtype=bool)
    if len(remains):
        _, nearest, _ = SpatialIndex(mesh.positions, mesh.faces).closest(remains)
        found[nearest] = True
    return found


def by_edges(mesh: Mesh) -> Bool:
    """(F,) small patches between sharp edges: tops and walls of letters, and whatever else is small."""
    surface = mesh.surface()
    one, other, alike = edge_table(mesh.faces).pairs()
    level = np.einsum("ni,ni->n", surface.normals[one // 3], surface.normals[other // 3]) > SHARP
    joined = level & alike
    patch = connected(len(mesh.faces), one[joined] // 3, other[joined] // 3)
    area = np.bincount(patch, surface.areas)
    return np.asarray((area < SMALL * area.sum())[patch])


def by_height(mesh: Mesh) -> Bool:
    """(F,) small parts that stand out of the surface, or lie in it, when all that is narrow is smoothed away."""
    normal = unit(igl.per_vertex_normals(mesh.positions, mesh.faces))
    height = np.abs(np.einsum("vi,vi->v", details(mesh, FINE), normal))
    found = (height > STANDS_OUT)[mesh.faces].any(axis=1)
    edges = edge_table(mesh.faces)
    part = edges.components()
    found &= np.bincount(part, ~found)[part] > 0  # a part of the asset that is narrow all over stands out of nothing
    piece = edges.among(found).components()
    low, high = (np.full((len(mesh.faces), 3), sign * np.inf) for sign in (1, -1))
    corners = mesh.positions[mesh.faces]
    np.minimum.at(low, piece, corners.min(axis=1))
    np.maximum.at(high, piece, corners.max(axis=1))
    long = np.linalg.norm(high - low, axis=1) > LONG
    return np.asarray(found & ~long[piece])


def details(mesh: Mesh, length: float) -> Float:
    """(V, 3) what features narrower than a ``length`` add to the positions: what an implicit step of mean curvature
    flow (Desbrun et al. 1999) takes away, and again of that, which leaves out what it shrinks of wide shapes."""
    matrix, area = laplacian(mesh)
    flow = diags_array(area) + length**2 * matrix
    step, left = splu(flow.tocsc()), mesh.positions
    for _ in range(2):
        left = left - step.solve(area[:, None] * left)
    return np.asarray(left)
