"""The components of surface in a watermark's box, projected along its normal: each must be single-valued there."""

from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection, FillRule, JoinType

from core.arrays import Float, Int
from core.embossing.mesh import WorkingMesh
from core.embossing.refusal import Refusal
from core.geometry.boxes import Boxes
from core.geometry.edges import connected, directed_edges, edge_table
from core.geometry.grouping import among
from core.geometry.products import cross, product
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.triangles import doubled_area

MIN_FACING = 0.15  # cosine between the box normal and a face's normal, at least
MARGIN = 0.16  # text heights around the text's rectangle within which faces belong to a patch
# Faces and patches in a box, and faces whose bounding boxes meet it, at most: half a second (measured: 20 microseconds
# a face, 100 a patch, 1 a face nearby).
MAX_FACES, MAX_PIECES, MAX_NEAR = 25_000, 1_000, 400_000
AREA_TOLERANCE = 1e-6  # relative; projected triangles overlap where their areas exceed their silhouette by more


@dataclass(frozen=True, eq=False)
class Patch:
    """An edge-connected piece of surface that faces the box.

    Attributes:
        faces: (K,) ids in the working mesh.
        vertices: (V,) topological vertices.
        points: (V, 3) in the box's frame, in units of the text's width; z along the box normal.
        triangles: (K, 3) into ``points``, counter-clockwise seen from +z.
        pairs: (P, 2) indices into ``triangles`` of faces that share an edge the patch is connected through.
        boundary: (E, 2) directed boundary edges, the patch on their left. Both directions of an edge are included
            where two of its faces belong to the patch but a third one does not.
    """

    faces: Int
    vertices: Int
    points: Float
    triangles: Int
    pairs: Int
    boundary: Int

    def silhouette(self) -> CrossSection:
        """The patch's outline in the box plane."""
        return CrossSection(_loops(self.boundary, self.points[:, :2]), FillRule.Positive)

    def inset_silhouette(self, clearance: float) -> CrossSection:
        """The region for letters: the silhouette without points closer than ``clearance`` to a boundary edge."""
        room = self.silhouette().offset(-clearance, JoinType.Miter)
        size = len(self.points)
        forward = self.boundary[:, 0] * size + self.boundary[:, 1]
        backward = self.boundary[:, 1] * size + self.boundary[:, 0]
        slits = self.points[self.boundary[among(forward, backward)], :2]
        if len(slits):
            along = slits[:, 1] - slits[:, 0]
            along *= clearance / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.finfo(float).tiny)
            across = np.column_stack([-along[:, 1], along[:, 0]])
            start, end = slits[:, 0] - along, slits[:, 1] + along
            quads = np.stack([start - across, end - across, end + across, start + across], axis=1)
            room -= CrossSection(list(quads), FillRule.Positive)
        return room

    def height(self, points: Float) -> Float:
        """(N,) z of the patch at (N, 2) ``points`` of the box plane, in text widths; nan beside it."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        at = points[:, None, :]
        weights = np.stack([doubled_area(p[:, :2], q[:, :2], at) for p, q in ((b, c), (c, a), (a, b))], axis=2)
        inside = np.asarray((weights >= 0).all(axis=2))
        under, which = inside.any(axis=1), inside.argmax(axis=1)
        share = np.take_along_axis(weights, which[:, None, None], axis=1)[:, 0]
        corners = np.stack([a[which, 2], b[which, 2], c[which, 2]], axis=1)
        total = np.maximum(share.sum(axis=1), np.finfo(float).tiny)
        return np.where(under, (share * corners).sum(axis=1) / total, np.nan)

    def projected_area(self) -> float:
        """The sum of the triangles' areas in the box plane."""
        a, b, c = (self.points[self.triangles[:, k], :2] for k in range(3))
        return float(np.sum(doubled_area(a, b, c)) / 2)


def _loops(edges: Int, points: Float) -> list[Float]:
    """Chains (E, 2) directed edges into closed rings of ``points``. Where rings touch in a vertex any pairing will
    do: the winding number of the plane is the same."""
    following: dict[int, list[int]] = {}
    for start, end in edges.tolist():
        following.setdefault(start, []).append(end)
    rings = []
    while following:
        start = next(iter(following))
        ring, current = [], start
        while True:
            ring.append(current)
            ends = following[current]
            step = ends.pop()
            if not ends:
                del following[current]
            current = step
            if current == start or current not in following:
                break
        rings.append(points[ring])
    return rings


def patches(mesh: WorkingMesh, box: Boxes, beside: float = 0.0, hidden: Int | None = None) -> list[Patch] | None:
    """Every edge-connected component of surface that meets the one ``box`` and faces it.

    They end at edges with one face or more than two, at the boundary of a coincident layer, and between neighbours of
    inconsistent winding; a watermark never crosses such an edge.

    Args:
        mesh: the working mesh.
        box: a single box; its width is the text's width.
        beside: text widths round the text's rectangle that count as well, if they are more than :data:`MARGIN`.
        hidden: ids of faces to leave out.

    Returns:
        The patches; None where they are more than can be cut in reasonable time.
    """
    center, axes, size = box.center[0], box.axes[0], box.size[0]
    width = size[0]
    margin = max(MARGIN * size[1], beside * width)
    reach = size / 2 + np.array([margin, margin, 0.0])
    extent = product(np.abs(axes).T, reach[:, None])[:, 0]
    ids = mesh.near(center - extent, center + extent)
    if len(ids) > MAX_NEAR:
        return None
    vertices, flat = np.unique(mesh.corners(ids), return_inverse=True)
    triangles = flat.reshape(-1, 3)
    points = product(mesh.points[vertices] - center, axes.T) / width
    corners = points[triangles]
    normal = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    low, high = corners.min(axis=1), corners.max(axis=1)
    chosen = (normal[:, 2] > MIN_FACING * length) & mesh.editable(ids)
    chosen &= np.all((high >= -reach / width) & (low <= reach / width), axis=1)
    if hidden is not None:
        chosen &= ~among(ids, hidden)
    if np.count_nonzero(chosen) > MAX_FACES:
        return None

    # The uses of each edge are counted over all faces near, also those that face away.
    first, second, agree = edge_table(triangles).pairs()
    one, two = first // 3, second // 3
    # A second layer below is not removed, so that its boundary must be the boundary of a patch too.
    reversed_copy = mesh.has_reversed_copy(ids)
    joined = agree & chosen[one] & chosen[two] & (reversed_copy[one] == reversed_copy[two])
    joined = np.flatnonzero(joined)[np.argsort(first[joined])]  # side by side, as the faces come
    pairs = np.column_stack([one, two])[joined]
    face = np.repeat(np.arange(len(ids)), 3)
    is_open = chosen[face]
    is_open[first[joined]] = is_open[second[joined]] = False
    edges = directed_edges(triangles)
    label = connected(len(ids), pairs[:, 0], pairs[:, 1])
    parts = _by_label(np.flatnonzero(chosen), label)
    if len(parts) > MAX_PIECES:
        return None
    rims = {int(label[face[rim[0]]]): edges[rim] for rim in _by_label(np.flatnonzero(is_open), label[face])}
    links = {
        int(label[pairs[link[0], 0]]): pairs[link] for link in _by_label(np.arange(len(pairs)), label[pairs[:, 0]])
    }
    none = np.empty((0, 2), dtype=np.int64)
    return [
        _patch(ids, vertices, points, triangles, links.get(part, none), rims.get(part, none), members)
        for members in parts
        for part in (int(label[members[0]]),)
    ]


def single_valued_patches(mesh: WorkingMesh, box: Boxes, index: SpatialIndex, beside: float) -> list[Patch] | Refusal:
    """The patches in ``box`` and ``beside`` text widths round it, each single-valued along its normal; faces hidden
    behind another layer are left out."""
    found = patches(mesh, box, beside)
    if found is None:
        return Refusal.TOO_DENSE
    layered = [patch for patch in found if _overlaps_in_projection(patch)]
    if not layered:
        return found
    faces = np.concatenate([patch.faces for patch in layered])
    normal, thickness = box.axes[0, 2], box.size[0, 2]
    centers = mesh.points[mesh.corners(faces)].mean(axis=1)
    start = 1e-3 * thickness
    distance, _ = index.first_hit(centers + start * normal, np.broadcast_to(normal, centers.shape), Eye.FAR)
    found = patches(mesh, box, beside, hidden=faces[distance <= thickness])
    assert found is not None  # fewer faces than before
    return Refusal.NOT_WHOLE if any(_overlaps_in_projection(patch) for patch in found) else found


def _overlaps_in_projection(patch: Patch) -> bool:
    area = patch.projected_area()
    return bool(area - patch.silhouette().area() > AREA_TOLERANCE * (1 + area))


def _by_label(which: Int, label: Int) -> list[Int]:
    """The items ``which`` in groups of equal ``label[item]``, by ascending label."""
    if not len(which):
        return []
    which = which[np.argsort(label[which], kind="stable")]
    return np.split(which, np.flatnonzero(np.diff(label[which])) + 1)


def _patch(ids: Int, vertices: Int, points: Float, triangles: Int, pairs: Int, boundary: Int, members: Int) -> Patch:
    used, local = np.unique(triangles[members], return_inverse=True)
    return Patch(
        faces=ids[members],
        vertices=vertices[used],
        points=points[used],
        triangles=local.reshape(-1, 3),
        pairs=np.searchsorted(members, pairs),
        boundary=np.searchsorted(used, boundary),
    )
