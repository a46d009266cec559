"""The new corners of an edited surface as accessor rows: local positions and attributes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bool, Float, Int
from core.errors import ErrorCode, MeshmarkError
from core.geometry.grouping import first_of_each, group_rows, ranks, without_copies
from core.geometry.products import applied, solved
from core.geometry.triangles import flat_normals, unit
from core.gltf.accessors import dequantize, read_accessor
from core.gltf.attributes import (
    Points,
    interpolate_attribute,
    interpolate_influences,
    orthogonal_tangents,
    read_rows,
)
from core.gltf.document import Document
from core.gltf.edit import Kind, SurfaceEdit
from core.gltf.primitives import DrawnPrimitive
from core.gltf.scene import SINGULAR, Scene, determinants
from core.gltf.skin import blend, influence_sets

# Fractions of an attribute's largest value to which the attributes of corners of one point agree that share a row; and
# normals of a wall, whose two triangles are never quite coplanar: a sixteenth of a degree.
SAME_ATTRIBUTE, SAME_WALL = 2.0**-20, 2.0**-10
SMOOTH = np.cos(np.radians(30))  # cosine; walls that meet at less than 30 degrees are a curve, and shaded smoothly


@dataclass(eq=False)
class CutPrimitives:
    """New triangles whose source primitives share their vertex attributes: C = 3M corners, in surface order.

    Attributes:
        drawn: indices into ``scene.primitives``, ascending.
        maps: semantic -> accessor, of the base mesh and then of each morph target.
        triangles: (M,) int64, their numbers in the edit.
        points: the corners in their source faces.
        vertex: (C,) int64 point ids.
        original: (C,) int64, the accessor row of a corner at an untouched vertex, or -1.
        wall: (C,) bool.
        tilt: (C, 3) float64, of the normals of the ground in the world: see :class:`core.gltf.edit.SurfaceEdit`.
        winding: (M,) float64, -1 where the transform of the triangle to the world mirrors it, else 1. That of a skin
            may, independent of its node's.
        linear: (C, 3, 3) float64, or (1, 3, 3) for all: transforms directions of the mesh's own frame to the world.
        local: (C, 3) float32 positions in the mesh's own frame; equal ids have equal positions in all of a node.
        values: one dictionary for each of ``maps``: semantic -> (C, n) float64.
    """

    drawn: list[int]
    maps: list[dict[str, int]]
    triangles: Int
    points: Points
    vertex: Int
    original: Int
    wall: Bool
    tilt: Float
    winding: Float
    linear: Float
    local: NDArray[np.float32]
    values: list[dict[str, Float]]


def cut_primitives(scene: Scene, edit: SurfaceEdit) -> list[CutPrimitives]:
    """The primitives that an edit touches, together where they share their vertex attributes.

    Raises:
        MeshmarkError: ``unsupported_feature`` where a vertex cannot be transformed back to its node's frame.
    """
    surface = scene.surface
    owner = surface.face_primitive[edit.source_face]
    together: dict[int, list[int]] = {}
    for index in np.union1d(surface.face_primitive[~edit.keep], owner).tolist():
        together.setdefault(scene.primitives[index].first_vertex, []).append(index)
    cuts = []
    for first_vertex, drawn in together.items():
        triangles = np.flatnonzero(np.isin(owner, drawn))
        original = edit.original[triangles].reshape(-1)
        maps = scene.primitives[drawn[0]].primitive.maps
        cut = CutPrimitives(
            drawn=drawn,
            maps=maps,
            triangles=triangles,
            points=Points(
                surface.faces[edit.corner_face[triangles]].reshape(-1, 3) - first_vertex,
                edit.barycentric[triangles].reshape(-1, 3),
            ),
            vertex=edit.vertex[triangles].reshape(-1),
            original=np.where(original >= 0, original - first_vertex, -1),
            wall=np.repeat(edit.kind[triangles] == Kind.WALL, 3),
            tilt=edit.tilt[triangles].reshape(-1, 3),
            winding=np.ones(len(triangles)),
            linear=np.empty((0, 3, 3)),
            local=np.empty((0, 3), np.float32),
            values=[{} for _ in maps],
        )
        _place(scene, surface.to_world(edit.position[triangles].reshape(-1, 3)), cut)
        cuts.append(cut)
    _share_points(scene, cuts)
    for cut in cuts:
        _interpolate(scene.document, cut)
    return cuts


def row_labels(cut: CutPrimitives, corners: Int) -> Int:
    """(N,) labels of ``corners`` (N,): equal for those that can share one row.

    These are corners of the same point, both of a wall or neither where there are normals, whose attributes agree.
    Positions, joints and weights belong to the point and need no comparison.
    """
    vertex, wall = cut.vertex[corners], cut.wall[corners] & has_normals(cut)
    compared = [
        (name, value)
        for values in cut.values
        for name, value in values.items()
        if name != "POSITION" and not name.startswith(("JOINTS_", "WEIGHTS_"))
    ]
    # Corners of most vertices are alike to the last bit: only those of the others are compared by rounded values.
    first = first_of_each(vertex)
    differs = wall != wall[first]
    for _, value in compared:
        for column in value.T:
            there = column[corners]
            differs |= there != there[first]
    rank = ranks(vertex)
    is_split = np.zeros(int(rank.max(initial=-1)) + 1, dtype=bool)
    is_split[rank[differs]] = True
    split = np.flatnonzero(is_split[rank])
    words = [rank[split, None].astype(np.uint32), wall[split, None].astype(np.uint32)]
    for name, value in compared:
        finite = np.nan_to_num(value)
        largest = max(float(np.abs(finite).max(initial=0.0)), np.finfo(np.float32).tiny)
        coarse = name in ("NORMAL", "TANGENT")
        step = np.where(wall[split] & coarse, SAME_WALL, SAME_ATTRIBUTE)[:, None] * largest
        words.append(np.round(finite[corners[split]] / step).astype(np.int32).view(np.uint32))
    part = group_rows(np.hstack(words))
    owner = np.empty(int(part.max(initial=-1)) + 1, dtype=np.int64)
    owner[part] = rank[split]
    whole = np.cumsum(~is_split) - ~is_split  # vertices of one label before each
    label = (whole + np.searchsorted(owner, np.arange(len(is_split))))[rank]
    label[split] = whole[rank[split]] + part
    return np.asarray(label)


def has_normals(cut: CutPrimitives) -> bool:
    """True where vertices carry normals, so that walls need rows of their own."""
    return any("NORMAL" in attributes for attributes in cut.maps)


def _place(scene: Scene, world: Float, cut: CutPrimitives) -> None:
    """Set the local positions of the corners, with the influences and morphs that transform them to the world.

    All corners of one point have those of the first of them, so that it stays one point in every pose.
    """
    document, drawn = scene.document, scene.primitives[cut.drawn[0]]
    first = _first_of_each(cut.vertex, cut.original)
    chosen, number = without_copies(first, np.zeros(len(first), dtype=bool))
    points, matrices = cut.points[chosen], drawn.matrices
    if influence_sets(cut.maps[0]):
        joints, weights = interpolate_influences(document, cut.maps[0], points)
        if drawn.skin is not None:
            matrices = blend(joints, weights, drawn.skin.matrices)
        influences: dict[str, Float] = {}
        for count in range(joints.shape[1] // 4):
            columns = slice(4 * count, 4 * count + 4)
            influences[f"JOINTS_{count}"] = joints[:, columns].astype(np.float64)
            influences[f"WEIGHTS_{count}"] = weights[:, columns]
        _keep_influences(document, cut.maps[0], influences, cut.original[chosen])
        cut.values[0] |= {name: values[number] for name, values in influences.items()}
    _require_invertible(drawn, matrices)
    local = solved(matrices[:, :, :3], world[chosen] - matrices[:, :, 3])
    winding, cut.linear = np.where(determinants(matrices) < 0, -1.0, 1.0), matrices[:, :, :3]
    if len(matrices) > 1:
        winding, cut.linear = winding[number[::3]], cut.linear[number]
    cut.winding *= winding
    for weight, target, values in zip(drawn.morph_weights, cut.maps[1:], cut.values[1:], strict=True):
        if "POSITION" in target:
            delta = interpolate_attribute(document, "POSITION", target["POSITION"], points).astype(np.float32)
            values["POSITION"] = delta.astype(np.float64)[number]
            local -= weight * delta.astype(np.float64)
    cut.local = local.astype(np.float32)[number]
    untouched = cut.original >= 0
    rows = read_rows(document, "POSITION", cut.maps[0]["POSITION"])
    cut.local[untouched] = rows[cut.original[untouched]]


def _keep_influences(document: Document, attributes: dict[str, int], influences: dict[str, Float], at: Int) -> None:
    """Give points ``at`` an untouched vertex, and not at -1, the joints and weights of its row to the last bit."""
    at_vertex = at >= 0
    for name, values in influences.items():
        accessor = attributes[name]
        entry = document.entry("accessors", accessor) | ({"normalized": True} if name.startswith("WEIGHTS_") else {})
        values[at_vertex] = dequantize(read_accessor(document, accessor)[at[at_vertex]], entry)


def _share_points(scene: Scene, cuts: list[CutPrimitives]) -> None:
    """Give the corners of one point one position across all primitives of their node, and the same influences and
    morphs across those that store these alike."""
    nodes: dict[tuple[int, int | None], list[CutPrimitives]] = {}
    alike: dict[tuple[tuple[int, int | None], str], list[CutPrimitives]] = {}
    for cut in cuts:
        drawn = scene.primitives[cut.drawn[0]]
        node = drawn.node.index, drawn.instance
        types = [
            [(name, scene.document.entry("accessors", accessors[name])["componentType"]) for name in values]
            for accessors, values in zip(cut.maps, cut.values, strict=True)
        ]
        nodes.setdefault(node, []).append(cut)
        alike.setdefault((node, repr(types)), []).append(cut)
    for group in nodes.values():
        for cut, local in zip(group, _shared(group, [cut.local for cut in group]), strict=True):
            cut.local = local
    for group in alike.values():
        for number, names in enumerate(group[0].values):
            for name in names:
                columns = _shared(group, [cut.values[number][name] for cut in group])
                for cut, values in zip(group, columns, strict=True):
                    cut.values[number][name] = values
    for cut in cuts:
        cut.values[0]["POSITION"] = cut.local.astype(np.float64)


def _shared(group: list[CutPrimitives], values: list[NDArray[Any]]) -> list[NDArray[Any]]:
    """The (C, n) ``values`` of each in the ``group``, with those of the first corner of the same point in any of it."""
    vertex = np.concatenate([cut.vertex for cut in group])
    original = np.concatenate([cut.original for cut in group])
    ends = np.cumsum([len(cut.vertex) for cut in group])
    return np.split(np.concatenate(values)[_first_of_each(vertex, original)], ends[:-1])


def _first_of_each(vertex: Int, original: Int) -> Int:
    """(C,) for each corner, the first corner of the same point, one at an untouched vertex before all others."""
    if not len(vertex):
        return np.empty(0, dtype=np.int64)
    place = np.empty(int(vertex.max()) + 1, dtype=np.int64)
    for corners in (np.arange(len(vertex)), np.flatnonzero(original >= 0)):
        place[vertex[corners[::-1]]] = corners[::-1]  # of several for one vertex, the last one stays
    return place[vertex]


def _require_invertible(drawn: DrawnPrimitive, matrices: Float) -> None:
    linear = matrices[:, :, :3]
    volume = np.linalg.norm(linear, axis=1).prod(axis=1)
    if not (np.abs(determinants(matrices)) > SINGULAR * volume).all():
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FEATURE,
            f"nodes[{drawn.node.index}] flattens its mesh, so that no letter can be put back into the mesh's own "
            "frame.",
            "Apply the transforms of that node to its mesh and send it again.",
        )


def _interpolate(document: Document, cut: CutPrimitives) -> None:
    """Fill ``cut.values`` with the attributes that :func:`_place` has not set."""
    first, points = first_of_each(cut.vertex), cut.points
    differs = np.zeros(len(first), dtype=bool)
    for column in (*points.rows.T, *points.barycentric.T):
        differs |= column != column[first]
    own, number = without_copies(first, differs)
    for attributes, values in zip(cut.maps, cut.values, strict=True):
        for name, accessor in attributes.items():
            if name not in values:
                values[name] = interpolate_attribute(document, name, accessor, points[own])[number]
    base, targets = cut.values[0], cut.values[1:]
    if "NORMAL" not in base:
        return
    flat = _flat_normals(cut, base["POSITION"])
    smooth = _tilted(unit(base["NORMAL"]), flat, cut)
    one, two, share = _curves(cut, flat, base["POSITION"])
    walls = _along_curves(flat, one, two, share)
    is_flat = (cut.wall | ~_any(smooth)) & _any(flat)
    normals = np.where(is_flat[:, None], walls, smooth)
    normals[~_any(normals)] = (0.0, 0.0, 1.0)  # a triangle without area or normals: any unit vector is valid
    base["NORMAL"] = normals
    for target in targets:
        if "NORMAL" in target and "POSITION" in target:
            turned = _along_curves(_flat_normals(cut, base["POSITION"] + target["POSITION"]), one, two, share)
            follows = cut.wall & flat.any(axis=1) & turned.any(axis=1)
            target["NORMAL"][follows] = (turned - walls)[follows]
    if "TANGENT" in base:
        base["TANGENT"][:, :3] = orthogonal_tangents(base["TANGENT"][:, :3], normals)
        handedness = read_rows(document, "TANGENT", cut.maps[0]["TANGENT"])[:, 3:]
        base["TANGENT"][:, 3:] = cut.points.nearest(handedness)


def _tilted(normals: Float, flat: Float, cut: CutPrimitives) -> Float:
    """(C, 3) unit ``normals`` of the ground in the mesh's own frame, tilted in the world as the letters on it are;
    those of a file that has them point inwards stay so. ``flat`` (C, 3) are outwards."""
    tilted = np.flatnonzero(_any(cut.tilt) & _any(normals))
    linear = cut.linear if len(cut.linear) == 1 else cut.linear[tilted]
    ground, tilt = normals[tilted], cut.tilt[tilted]
    # A normal is a row: n A in the mesh's frame where it is n in the world, and n inv(A) the other way round.
    upright = linear.transpose(0, 2, 1)
    world = unit(solved(upright, ground))
    inwards = np.einsum("ni,ni->n", ground, flat[tilted]) < 0
    tilt = np.where(inwards[:, None], -tilt, tilt)
    result = normals.copy()
    result[tilted] = unit(applied(upright, world + tilt))
    return result


def _any(vectors: Float) -> Bool:
    """(N,) those of (N, 3) vectors that are not zero; a reduction over so short an axis would be slow."""
    x, y, z = (vectors != 0).T
    return np.asarray(x | y | z)


def _curves(cut: CutPrimitives, flat: Float, local: Float) -> tuple[Int, Int, Float]:
    """Pairs (P,), (P,) of wall corners at one point that are shaded as one curve, each with itself too, and the angle
    (P,) of the triangle at the second: the weight of its normal."""
    wall = np.flatnonzero(cut.wall & _any(flat))
    wall = wall[np.argsort(cut.vertex[wall], kind="stable")]
    _, start, which, size = np.unique(cut.vertex[wall], return_index=True, return_inverse=True, return_counts=True)
    reach = size[which]
    one = np.repeat(np.arange(len(wall)), reach)
    two = np.repeat(start[which], reach) + np.arange(len(one)) - np.repeat(np.cumsum(reach) - reach, reach)
    one, two = wall[one], wall[two]
    curved = np.einsum("pi,pi->p", flat[one], flat[two]) > SMOOTH
    one, two = one[curved], two[curved]
    corner = local.reshape(-1, 3, 3)[two // 3]
    at = np.arange(len(two)), two % 3
    to = [unit(corner[at[0], (at[1] + step) % 3] - corner[at]) for step in (1, 2)]
    return one, two, np.arccos(np.clip(np.einsum("pi,pi->p", *to), -1, 1))


def _along_curves(flat: Float, one: Int, two: Int, share: Float) -> Float:
    """``flat`` (C, 3) normals, those of the corners ``one`` the mean over their ``two``, weighted by ``share``."""
    total = [np.bincount(one, weights=share * flat[two, axis], minlength=len(flat)) for axis in range(3)]
    mean = unit(np.column_stack(total).astype(np.float64))  # of no corners bincount counts integers
    return np.where(_any(mean)[:, None], mean, flat)


def _flat_normals(cut: CutPrimitives, local: Float) -> Float:
    """(C, 3) normals of the new triangles at local corner positions (C, 3), outwards in the mesh's own frame."""
    return np.repeat(flat_normals(local.reshape(-1, 3, 3)) * cut.winding[:, None], 3, axis=0)
