"""A GLB document as one working surface, with the way back from every face to its accessor rows."""

import json
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bool, Float, Int
from core.errors import ErrorCode, MeshmarkError
from core.geometry.grouping import float_words, group_rows
from core.geometry.products import cross, product
from core.geometry.surface import MODEL_SIZE, Surface
from core.gltf.accessors import read_values
from core.gltf.document import Document, malformed, typed
from core.gltf.hierarchy import Node, read_nodes, world_matrices
from core.gltf.instances import instance_matrices
from core.gltf.primitives import (
    TRIANGLE_FAN,
    TRIANGLE_STRIP,
    TRIANGLES,
    DrawnPrimitive,
    Primitive,
    PrimitiveReader,
)
from core.gltf.skin import Skin, blend, influence_sets, read_influences, read_skin
from core.gltf.textures import ReadTexture, texture_reader
from core.gltf.viewer import Look, Viewed, has_area, viewed

SINGULAR = 1e-6  # |det| over the product of the column lengths; matrices of less count as singular
BEYOND = 1e6  # size-30 units; coordinates of undrawn vertices are clamped to this, so that nothing overflows


@dataclass(frozen=True, eq=False)
class Scene:
    """A document as it is drawn.

    Attributes:
        document: the file; stages that ask for pixels or vertex attributes read them there.
        nodes: of the default scene, parents before their children.
        surface: all triangles.
        primitives: that ``Surface.face_primitive`` counts.
    """

    document: Document
    nodes: tuple[Node, ...]
    surface: Surface
    primitives: tuple[DrawnPrimitive, ...]

    @cached_property
    def texture(self) -> ReadTexture:
        """The reader of the document's textures for analysis, which keeps the last ones."""
        return texture_reader(self.document)

    @cached_property
    def viewed(self) -> Viewed:
        """Visibility of the faces of ``surface`` in a viewer."""
        return viewed(self.document, self.surface, self.primitives)


@dataclass(frozen=True, eq=False)
class _Shape:
    """The vertices that primitives of one mesh with the same attributes share, before they are placed.

    ``matrices`` and ``skin`` are ``None`` where no skin moves them.
    """

    local: NDArray[np.float32]
    morphed: Float
    matrices: Float | None
    skin: Skin | None
    morph_weights: Float
    deformed: bool


@dataclass(frozen=True, eq=False)
class _Vertices:
    """A shape as one node, or one instance of it, draws it; ``owner`` numbers these."""

    owner: int
    node: Node
    instance: int | None
    first: int
    shape: _Shape
    matrices: Float
    world: Float


def scene_of(glb: bytes) -> Scene:
    """The scene of a GLB, see :func:`flatten`.

    Raises:
        MeshmarkError: as :meth:`core.gltf.document.Document.from_glb` and :func:`flatten`.
    """
    return flatten(Document.from_glb(glb))


def flatten(document: Document) -> Scene:
    """Every triangle of the default scene in one size-30 :class:`Surface`, at the default pose.

    Node transforms, instances, skins, default morph weights, strips, fans and quantised positions are applied.
    Points, lines and instances that a skin or an animation of morph weights moves are left out: they stay in the file
    as they are. The frame is that of the faces that a viewer draws: hidden ones and those without area do not count.

    Raises:
        MeshmarkError: ``no_faces``, ``non_finite_positions``, ``index_out_of_range``, ``malformed_file``,
            ``external_reference``.
    """
    worlds, nodes = world_matrices(document), read_nodes(document)
    reader = PrimitiveReader(document)
    blocks: list[_Vertices] = []
    primitives: list[DrawnPrimitive] = []
    rows = owner = 0
    for node in nodes:
        if node.mesh is None:
            continue
        placements = _placements(document, node, worlds)
        shapes, drawn = _read_mesh(document, node, node.mesh, worlds, reader) if placements else ({}, [])
        for instance, world in placements:
            placed: dict[str, _Vertices] = {}
            for key, primitive in drawn:
                if key not in placed:
                    placed[key] = _place(shapes[key], owner, node, instance, world, rows)
                    rows += len(shapes[key].local)
                if len(primitive.triangles):
                    primitives.append(_draw(placed[key], primitive, world))
            blocks += placed.values()
            owner += 1
    if not primitives:
        raise _no_faces("The asset has no triangles in its default scene.")
    return Scene(document, nodes, _surface(document, blocks, primitives), tuple(primitives))


def _placements(document: Document, node: Node, worlds: Float) -> list[tuple[int | None, Float]]:
    """(instance, mesh -> world matrix) of each time that a node draws its mesh."""
    instances = instance_matrices(document, node.index)
    if instances is None:
        return [(None, worlds[node.index])]
    if node.skin is not None or _has_animated_weights(document, node.index):
        return []
    with np.errstate(over="ignore", invalid="ignore"):  # refused where vertices are placed
        return list(enumerate(product(worlds[node.index], instances)))


def _has_animated_weights(document: Document, node: int) -> bool:
    channels = [
        channel
        for animation in typed(document.json, "animations", list)
        for channel in typed(animation, "channels", list)
    ]
    return any(
        typed(channel, "target", dict).get("node") == node and channel["target"].get("path") == "weights"
        for channel in channels
    )


def _read_mesh(
    document: Document, node: Node, number: int, worlds: Float, reader: PrimitiveReader
) -> tuple[dict[str, _Shape], list[tuple[str, Primitive]]]:
    """The shapes of the mesh ``number``, which a node draws, by a key, and its primitives of triangles with theirs."""
    entry, mesh = document.entry("nodes", node.index), document.entry("meshes", number)
    weights = typed(entry if "weights" in entry else mesh, "weights", list)
    shapes: dict[str, _Shape] = {}
    drawn = []
    for index, primitive in enumerate(typed(mesh, "primitives", list)):
        if not isinstance(primitive, dict):
            raise malformed(f"meshes[{number}].primitives[{index}] is not a JSON object.")
        if primitive.get("mode", TRIANGLES) not in (TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN):
            continue
        if "POSITION" not in typed(primitive, "attributes", dict):
            continue
        key = json.dumps([primitive["attributes"], primitive.get("targets")], sort_keys=True)
        if key not in shapes:
            shapes[key] = _read_shape(document, node, primitive, weights, worlds)
        drawn.append((key, reader.read(number, index, primitive, len(shapes[key].local))))
    return shapes, drawn


@np.errstate(over="ignore", invalid="ignore")  # overflowing vertices are refused once they are placed
def _read_shape(document: Document, node: Node, primitive: dict[str, Any], weights: list[Any], worlds: Float) -> _Shape:
    attributes, targets = primitive["attributes"], typed(primitive, "targets", list)
    if not all(isinstance(target, dict) for target in targets) or not all(_is_number(weight) for weight in weights):
        raise malformed(f"The morph targets that nodes[{node.index}] draws, or their weights, are not well-formed.")
    _check_attributes(document, [attributes, *targets])
    local = read_values(document, attributes["POSITION"])
    morph_weights = np.zeros(len(targets))
    morph_weights[: len(weights)] = weights[: len(targets)]
    morphed = local
    for target, weight in zip(targets, morph_weights, strict=True):
        if weight and "POSITION" in target:
            morphed = morphed + weight * read_values(document, target["POSITION"])
    skin = matrices = None
    if node.skin is not None and influence_sets(attributes):
        skin = read_skin(document, node.skin, worlds)  # the transform of a skinned node itself is ignored
        matrices = blend(*read_influences(document, attributes), skin.matrices)
    deformed = skin is not None or morphed is not local
    return _Shape(local.astype(np.float32), morphed, matrices, skin, morph_weights, deformed)


@np.errstate(over="ignore", invalid="ignore")  # overflowing vertices are refused at the end
def _place(shape: _Shape, owner: int, node: Node, instance: int | None, world: Float, first: int) -> _Vertices:
    """Transform the vertices of a shape to the world."""
    matrices = world[None, :3] if shape.matrices is None else shape.matrices
    # Not a matrix product: it must round the same for equal rows.
    placed = matrices[:, :, 3] + sum(matrices[:, :, axis] * shape.morphed[:, axis, None] for axis in range(3))
    if not np.isfinite(placed).all():
        raise MeshmarkError(
            ErrorCode.NON_FINITE_POSITIONS,
            f"The mesh that nodes[{node.index}] draws has positions that are not finite numbers.",
            "Remove the broken vertices, or export the asset again.",
        )
    return _Vertices(owner, node, instance, first, shape, matrices, placed)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _check_attributes(document: Document, maps: list[dict[str, Any]]) -> None:
    """Refuse attributes, of the base mesh or its morph targets, that the vertices of one primitive cannot have."""
    count = document.entry("accessors", maps[0]["POSITION"]).get("count")
    for number, attributes in enumerate(maps):
        expected = {"POSITION": "VEC3", "NORMAL": "VEC3", "TANGENT": "VEC3" if number else "VEC4"}
        for name, index in attributes.items():
            accessor = document.entry("accessors", index)
            if accessor.get("count") != count:
                raise malformed(f"accessors[{index}] ({name}) does not have a row for each of {count} positions.")
            kind = "VEC4" if name.startswith(("JOINTS_", "WEIGHTS_")) else expected.get(name, accessor.get("type"))
            if accessor.get("type") != kind:
                raise malformed(f"accessors[{index}] ({name}) is not of type {kind}.")


def determinants(matrices: Float) -> Float:
    """(M,) of the linear parts of matrices (M, 3, 4)."""
    x, y, z = (matrices[:, :, axis] for axis in range(3))
    return np.asarray(np.einsum("vi,vi->v", cross(x, y), z))


@np.errstate(over="ignore", invalid="ignore")  # a matrix this large is not invertible in any useful sense
def _draw(vertices: _Vertices, primitive: Primitive, world: Float) -> DrawnPrimitive:
    matrices = vertices.matrices if len(vertices.matrices) == 1 else vertices.matrices[np.unique(primitive.triangles)]
    columns = [matrices[:, :, axis] for axis in range(3)]
    determinant = determinants(matrices)
    volume = np.prod([np.linalg.norm(column, axis=1) for column in columns], axis=0)
    return DrawnPrimitive(
        node=vertices.node,
        primitive=primitive,
        instance=vertices.instance,
        first_vertex=vertices.first,
        matrices=vertices.matrices,
        skin=vertices.shape.skin,
        morph_weights=vertices.shape.morph_weights,
        mirrored=bool(determinants(world[None, :3])[0] < 0),
        invertible=bool((np.abs(determinant) > SINGULAR * volume).all()),
    )


def _surface(document: Document, blocks: list[_Vertices], primitives: list[DrawnPrimitive]) -> Surface:
    world = np.concatenate([block.world for block in blocks])
    faces = np.concatenate(
        [drawn.first_vertex + drawn.triangles[:, [0, 2, 1] if drawn.mirrored else [0, 1, 2]] for drawn in primitives]
    )
    low, high = _bounds(document, world, faces, primitives)
    side = float((high - low).max())
    if not 0.0 < side < np.inf or not np.isfinite(MODEL_SIZE / side):
        raise _no_faces("The asset has no extent: all its triangles lie in one point, or its size overflows.")
    offset = low + (high - low) / 2
    scale = MODEL_SIZE / side
    counts = [len(drawn.triangles) for drawn in primitives]
    with np.errstate(over="ignore"):  # only undrawn vertices are outside the frame
        positions = (world - offset) * scale
    positions = np.clip(positions, -BEYOND, BEYOND, out=positions)
    return Surface(
        positions=positions,
        faces=faces,
        weld=_weld(blocks),
        face_primitive=np.repeat(np.arange(len(primitives)), counts),
        face_triangle=np.concatenate([np.arange(count) for count in counts]),
        scale=scale,
        offset=offset,
    )


def _bounds(document: Document, world: Float, faces: Int, primitives: list[DrawnPrimitive]) -> tuple[Float, Float]:
    """The lowest and highest corner (3,) of the faces that are drawn and have an area; where there are none, of those
    that have an area, else of all."""
    used = np.zeros(len(world), dtype=bool)
    used[faces] = True
    low, high = _extremes(world[used])
    # Nearly always drawn faces reach all six sides, and the others need no test.
    x, y, z = ((axis == least) | (axis == most) for axis, least, most in zip(world.T, low, high, strict=True))
    outermost = x | y | z
    rim = world[faces[_counting(document, world, faces, primitives, outermost[faces].any(axis=1))]].reshape(-1, 3)
    if len(rim) and (rim.min(axis=0) == low).all() and (rim.max(axis=0) == high).all():
        return low, high
    counting = _counting(document, world, faces, primitives, np.ones(len(faces), dtype=bool))
    if not len(counting):
        counting = np.flatnonzero(has_area(world[faces]))
    if not len(counting):
        return low, high
    corners = world[faces[counting]].reshape(-1, 3)
    return corners.min(axis=0), corners.max(axis=0)


def _extremes(points: Float) -> tuple[Float, Float]:
    """(3,) lowest and highest coordinates of (N, 3) points; a reduction over their rows would be slow."""
    return np.array([axis.min() for axis in points.T]), np.array([axis.max() for axis in points.T])


def _counting(document: Document, world: Float, faces: Int, primitives: list[DrawnPrimitive], tested: Bool) -> Int:
    """Those of the faces ``tested`` (F,) that are drawn and have an area."""
    look, first = Look(document), 0
    found = []
    for drawn in primitives:
        which = np.flatnonzero(tested[first : first + len(drawn.triangles)])
        if len(which):
            which = which[look.drawn(drawn, drawn.triangles[which])[0]]
            found.append(first + which)
        first += len(drawn.triangles)
    drawn_faces = np.concatenate([np.empty(0, dtype=np.int64), *found])
    return drawn_faces[has_area(world[faces[drawn_faces]])]


def _weld(blocks: list[_Vertices]) -> Int:
    """Labels that are equal where owner, local float position and, under deformation, world position are."""
    deformed = {block.owner for block in blocks if block.shape.deformed}
    owner = np.repeat([block.owner for block in blocks], [len(block.world) for block in blocks])
    words = [owner[:, None].astype(np.uint32), float_words(np.concatenate([block.shape.local for block in blocks]))]
    if deformed:
        # Equal local positions of a rigid node have equal world positions anyway: zeros keep its rows out of this.
        moved = [block.world if block.owner in deformed else np.zeros_like(block.world) for block in blocks]
        words.append(float_words(np.concatenate(moved)))
    return group_rows(np.hstack(words))


def _no_faces(sentence: str) -> MeshmarkError:
    return MeshmarkError(ErrorCode.NO_FACES, sentence, "Send a mesh with triangles that span an area.")
