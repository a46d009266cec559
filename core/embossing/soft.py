"""Letters of a soft profile: the ground under them is triangulated along their contours and displaced by their height
field along its smooth normals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.embossing.check import is_closed
from core.embossing.height_field import HeightField, eased
from core.embossing.lift import MIN_AGREEMENT, obstructed
from core.embossing.mesh import WorkingMesh
from core.embossing.patch import Patch
from core.embossing.refusal import Refusal
from core.embossing.remesh import Remesh, remesh
from core.geometry.boxes import Boxes
from core.geometry.products import cross, dot, length, product
from core.geometry.segments import distance_to_edges
from core.geometry.spatial import SpatialIndex
from core.geometry.triangles import unit
from core.gltf.edit import Kind

STILL, STEADY = 0.004, 0.02  # share of the relief, and change of it in a deviation of the slope, up to which it is 0
EASE = 2.5  # deviations of the slope in which heights are eased to 0 at the rim
TURNED = 1e-3  # share of the area that displacement may turn over: slivers of rounding errors


@dataclass(frozen=True, eq=False)
class Displaced:
    """The new surface of one patch in the mesh's own numbers.

    Attributes:
        removed: (K,) face ids.
        points: (N, 3) new vertices, numbered from ``first`` on.
        bases: (N, 3) their feet on the surface.
        tilts: (N, 3) of their normals: see :class:`core.gltf.edit.SurfaceEdit`.
        corners: (M, 3) of the new triangles.
        source: (M, 3) surface faces under their corners.
        kind: (M,) of each, a :class:`~core.gltf.edit.Kind`.
        letters: (L, 3) points between which the letters are, raised and on the ground.
    """

    removed: Int
    points: Float
    bases: Float
    tilts: Float
    corners: Int
    source: Int
    kind: NDArray[np.int8]
    letters: Float


def displaced(
    mesh: WorkingMesh, box: Boxes, patch: Patch, field: HeightField, relief: float, index: SpatialIndex, first: int
) -> Displaced | Refusal:
    """The ground of ``patch`` under ``field``, displaced by it; the mesh stays as it is.

    Where other surface lies close below, such as the other side of a thin wall, raised letters have no trench.

    Args:
        mesh: that the patch is of.
        box: the single box that the patch is in.
        patch: of the letters, which lie inside it.
        field: their heights.
        relief: size-30 units; negative where they are sunken.
        index: of the original surface.
        first: number of the first new vertex.
    """
    width = float(box.size[0, 0])
    found = remesh(patch, _rows(mesh, patch), field, abs(relief) / width)
    if found is None:
        return Refusal.CUT_FAILED
    bases = box.center[0] + width * product(found.points, box.axes[0])
    height, gradient = _heights(field, found)
    for along in (product(_normals(patch, found), box.axes[0]), np.broadcast_to(box.axes[0, 2], bases.shape)):
        rises = height, gradient
        if relief > 0 and _shallow(mesh, patch, found, bases, along, relief * height, index):
            level = height > 0
            rises = height * level, gradient * level[:, None]
        points = bases + relief * rises[0][:, None] * along
        if not _turned(bases, points, found.triangles):
            break
    else:
        return Refusal.FOLDED
    is_lettered = np.zeros(len(bases), dtype=bool)
    is_lettered[found.triangles[found.letters]] = True
    lettered = np.flatnonzero(is_lettered)
    if obstructed(bases[lettered], bases[lettered] + relief * along[lettered], relief, index).any():
        return Refusal.SECOND_LAYER if relief > 0 else Refusal.THIN_WALL
    across = product(relief / width * rises[1], box.axes[0, :2])
    tilts = np.einsum("ni,ni->n", across, along)[:, None] * along - across
    return _numbered(mesh, patch, found, (bases, points, tilts), lettered, first)


def _rows(mesh: WorkingMesh, patch: Patch) -> Int:
    """(K, 3) numbers of the corners of the patch's triangles, equal where these share a row of one primitive; corners
    at a vertex of an earlier mark share one with those of the same source only."""
    surface, source = mesh.surface, mesh.source(patch.faces)
    rows, corners = surface.faces[source], patch.vertices[patch.triangles]
    same = surface.weld[rows][:, None, :] == corners[:, :, None]
    row = np.take_along_axis(rows, same.argmax(axis=2), axis=1)
    row = np.where(same.any(axis=2), row, len(surface.positions) + source[:, None])
    primitive = surface.face_primitive[source]
    return np.asarray(row * (int(primitive.max()) + 1) + primitive[:, None])


def _heights(field: HeightField, found: Remesh) -> tuple[Float, Float]:
    """(N,) heights at the new points, and (N, 2) their gradients: those of the field, eased to 0 round the new
    triangles, and 0 on what these do not use."""
    plane = found.points[:, :2]
    (height, gradient), nearest = field.with_gradient(plane), plane.copy()
    reach = EASE * field.slope
    distance = distance_to_edges(plane, field.near(plane[found.boundary]), reach, nearest)
    share = np.minimum(distance / reach, 1.0)
    away = unit(plane - nearest)
    steep = 6 * share * (1 - share) / reach
    gradient = eased(share)[:, None] * gradient + (steep * height)[:, None] * away
    height *= eased(share)
    # Where the trench runs out the ground stays as it is, to the last digit: what is not moved can carry other marks.
    still = (np.abs(height) < STILL) & (length(gradient) * field.slope < STEADY)
    unused = np.ones(len(plane), dtype=bool)
    unused[found.triangles.ravel()] = False
    still |= unused
    still[found.boundary.ravel()] = True
    height[still] = 0.0
    gradient[still] = 0.0
    return height, gradient


def _normals(patch: Patch, found: Remesh) -> Float:
    """(N, 3) smooth unit normals of the ground at the new points, in the patch's frame: those of its triangles by their
    areas, interpolated; along the box normal where they are far from it."""
    corners = patch.points[patch.triangles]
    area = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    vertex = np.zeros_like(patch.points)
    for corner in range(3):
        np.add.at(vertex, patch.triangles[:, corner], area)
    normals = unit(np.einsum("nk,nki->ni", found.weights, unit(vertex)[patch.triangles[found.point_faces]]))
    normals[normals[:, 2] < MIN_AGREEMENT] = (0.0, 0.0, 1.0)
    return normals


def _shallow(
    mesh: WorkingMesh, patch: Patch, found: Remesh, bases: Float, along: Float, rise: Float, index: SpatialIndex
) -> bool:
    """True where a trench would come through to other surface below."""
    if mesh.has_remaining_copy(patch.faces[found.replaced]).any():
        return True
    low = rise < 0
    depth = float(rise.min(initial=0.0))
    return bool(low.any() and obstructed(bases[low], bases[low] - along[low], depth, index).any())


def _turned(bases: Float, points: Float, triangles: Int) -> bool:
    """True where the ``triangles`` (M, 3) between ``points`` face away from those between their ``bases``."""
    a, b, c = triangles.T
    before, after = (cross(at[b] - at[a], at[c] - at[a]) for at in (bases, points))
    facing = dot(before, after) / np.maximum(length(before), np.finfo(float).tiny)
    return bool(-facing[facing < 0].sum() > TURNED * np.abs(facing).sum())


def _numbered(
    mesh: WorkingMesh, patch: Patch, found: Remesh, vertices: tuple[Float, Float, Float], lettered: Int, first: int
) -> Displaced | Refusal:
    """The new surface in the mesh's numbers: vertices that have not moved keep theirs. ``vertices`` are the bases,
    points and tilts (N, 3)."""
    bases, points, tilts = vertices
    known = len(patch.points)
    moved = (bases != points).any(axis=1)
    is_new = moved.copy()
    is_new[known:] = True
    new = np.flatnonzero(is_new)
    number = np.concatenate([patch.vertices, np.full(len(points) - known, -1)])
    number[new] = first + np.arange(len(new))
    corners, boundary = number[found.triangles], patch.vertices[found.boundary]
    if not is_closed(patch.vertices[patch.triangles[found.replaced]], boundary, corners):
        return Refusal.NOT_CLOSED
    source = mesh.source(patch.faces)[found.corner_faces]
    several = (source != source[:, :1]).any(axis=1)
    ground = np.where(several | moved[found.triangles].any(axis=1), Kind.TRENCH, Kind.SURFACE)
    return Displaced(
        removed=patch.faces[found.replaced],
        points=points[new],
        bases=bases[new],
        tilts=tilts[new],
        corners=corners,
        source=source,
        kind=np.where(found.letters, Kind.CAP, ground).astype(np.int8),
        letters=np.concatenate([bases[lettered], points[lettered]]),
    )
