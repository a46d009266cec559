"""Writes an edited surface back into its GLB: touched primitives get new accessors, and their old bytes are removed."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.geometry.grouping import first_of_each
from core.geometry.morton import morton_order
from core.gltf.accessors import dequantize
from core.gltf.attributes import encode, read_rows
from core.gltf.builder import Builder
from core.gltf.colors import hex_linear
from core.gltf.compact import drop_unused_rows, kept_outline
from core.gltf.compression import DRACO
from core.gltf.document import Document
from core.gltf.edit import LETTERS, Style, SurfaceEdit
from core.gltf.hierarchy import hidden_nodes, scene_nodes
from core.gltf.instances import instance_attributes, split_off
from core.gltf.materials import UNLIT, Material
from core.gltf.primitives import TRIANGLES, Primitive
from core.gltf.references import OUTLINE
from core.gltf.scene import Scene
from core.gltf.tint import Tints
from core.gltf.vertices import CutPrimitives, cut_primitives, has_normals, row_labels

Owner = tuple[int, int | None]  # a node, and the number of its instance
Replacement = tuple[dict[str, Any] | None, list[dict[str, Any]]]  # the surface and the coloured letters of a primitive

# Attributes that a plain material does not use, or that would tint it.
TEXTURING = ("TANGENT", "TEXCOORD_", "COLOR_")


def write(scene: Scene, edit: SurfaceEdit, styles: Sequence[Style], tints: Tints | None = None) -> bytes:
    """The scene's GLB with ``edit`` applied.

    A touched primitive gets new accessors with the rows that it draws and no others, old and new ones alike in the
    order of a space-filling curve. Its old accessors, and all other unreferenced bytes, are removed: see
    :func:`core.gltf.prune.prune`. Untouched primitives keep their exact values, images their exact bytes. A mesh that
    other nodes of the scene draw too is cloned for the node that was touched; nodes that the scene does not show draw
    the edited one. Same input, same bytes.

    Args:
        scene: that the edit refers to.
        edit: removed faces and new triangles.
        styles: of each mark that ``edit.mark`` counts. Caps and walls with a colour have it in the vertices of the
            source primitive, and lie on an even patch of its texture: see :mod:`core.gltf.tint`. Where that cannot be,
            they are a primitive with a plain material, which is unlit where the source is, and then need not glow.
        tints: of the scene's document, if they are known.

    Raises:
        MeshmarkError: ``unsupported_feature`` where a touched vertex cannot be transformed back to its node's frame.
    """
    if edit.keep.all() and not len(edit.source_face):
        return scene.document.to_glb()
    editor = Builder(scene.document)
    paint, tints = _Paint(editor), tints or Tints(scene.document)
    # Styles are numbered so that letters of one style share a primitive; 0 is the source's own.
    palette = [style for style in dict.fromkeys(styles) if style.color is not None]
    look_of_mark = np.array([palette.index(style) + 1 if style in palette else 0 for style in styles], dtype=np.int64)
    changes: dict[Owner, dict[int, Replacement]] = {}
    for cut in cut_primitives(scene, edit):
        owner = scene.surface.face_primitive[edit.source_face[cut.triangles]]
        is_letter = np.isin(edit.kind[cut.triangles], LETTERS)
        look = np.where(is_letter, look_of_mark[edit.mark[cut.triangles]], 0)
        factors = _tint(scene, cut, owner, look, tints, palette)
        table = _rows(scene.document, cut, deep=bool(factors))
        base: dict[int, Int] = {}
        letters: dict[int, list[tuple[int, Int]]] = {}
        for index in cut.drawn:
            drawn, mine = scene.primitives[index], owner == index
            first = np.searchsorted(scene.surface.face_primitive, index)  # its faces are consecutive, in order
            kept = drawn.triangles[edit.keep[first : first + len(drawn.triangles)]]
            added = table.corners.reshape(-1, 3)[mine][:, [0, 2, 1] if drawn.mirrored else [0, 1, 2]]
            painted = look[mine]
            base[index] = np.concatenate([kept, added[painted == 0]])
            if drawn.primitive.is_blended:
                came = scene.surface.face_triangle[edit.source_face[cut.triangles][mine][painted == 0]]
                stay = np.flatnonzero(edit.keep[first : first + len(drawn.triangles)])
                base[index] = base[index][np.argsort(np.concatenate([stay, came]), kind="stable")]
            letters[index] = [(number, added[painted == number]) for number in np.unique(painted[painted > 0]).tolist()]
        together = [triangles for index, triangles in base.items() if len(triangles) and index not in factors]
        shared = _Vertices(editor, cut, table, together)
        for index in cut.drawn:
            drawn, source = scene.primitives[index], scene.primitives[index].primitive
            rest = None
            if index in factors:
                own = _Vertices(editor, cut, table.darkened(factors[index]), [base[index]])
                rest = own.primitive(source, base[index]) | {"material": paint.freed(source.material)}
            elif len(base[index]):
                rest = shared.primitive(source, base[index])
            changes.setdefault((drawn.node.index, drawn.instance), {})[source.number] = (
                rest,
                [
                    paint.primitive(source, cut, table, triangles, palette[number - 1])
                    for number, triangles in letters[index]
                ],
            )
    _replace_primitives(editor, changes)
    drop_unused_rows(editor)
    return editor.to_document().to_glb()


def _tint(
    scene: Scene, cut: CutPrimitives, owner: Int, look: Int, tints: Tints, palette: Sequence[Style]
) -> dict[int, Float]:
    """Give letters their colour in the attributes of their corners where that is possible, and take their ``look`` (M,)
    back to 0.

    Returns:
        The factor (3,) of each drawn primitive (``owner`` (M,)) that has to go from its material into its vertices.
    """
    factors: dict[int, Float] = {}
    for index in cut.drawn:
        source, mine = scene.primitives[index].primitive, owner == index
        numbers = np.unique(look[mine & (look > 0)]).tolist()
        found = {number: tint for number in numbers if (tint := tints.of(source, palette[number - 1])) is not None}
        moved = any(tint.moved for tint in found.values())
        factor, tinted = np.clip(source.material.color[:3], 0, 1), np.zeros(len(cut.vertex), dtype=bool)
        if found and "COLOR_0" not in cut.values[0]:
            cut.values[0]["COLOR_0"] = np.ones((len(cut.vertex), 4))
        for number, tint in found.items():
            corners = np.repeat(mine & (look == number), 3)
            look[mine & (look == number)] = 0
            cut.original[corners] = -1
            cut.values[0]["COLOR_0"][corners, :3] = tint.color * (factor if moved and not tint.moved else 1.0)
            cut.values[0]["COLOR_0"][corners, 3:] = 1.0
            if tint.uv is not None:
                cut.values[0][f"TEXCOORD_{source.material.uv_set}"][corners] = tint.uv
            tinted |= corners
        if moved:
            ground = np.repeat(mine, 3) & ~tinted
            cut.values[0]["COLOR_0"][ground, :3] *= factor
            factors[index] = factor
    return factors


@dataclass(frozen=True, eq=False)
class _Rows:
    """The vertex rows of cut primitives: those of the file, then new ones.

    Attributes:
        values: for each map of the primitives, semantic -> (V, n), in the component type that is written.
        corners: (C,) the row of each of their new corners.
        local: (V, 3) positions.
        old: number of the rows of the file.
    """

    values: list[dict[str, NDArray[Any]]]
    corners: Int
    local: Float
    old: int

    def darkened(self, factor: Float) -> "_Rows":
        """The rows with the vertex colours of the file times a ``factor`` (3,), which those of new rows have."""
        values = self.values[0]["COLOR_0"]
        colors = _fractions(values)
        colors[: self.old, :3] *= factor
        changed = self.values[0] | {"COLOR_0": encode(colors, values.dtype, normalized=True)}
        return replace(self, values=[changed, *self.values[1:]])


def _rows(document: Document, cut: CutPrimitives, deep: bool) -> _Rows:
    """The rows of cut primitives. New vertex colours have 8 bits, for white ground needs no more; where they must be
    ``deep``, 16."""
    new = np.flatnonzero((cut.original < 0) | (cut.wall & has_normals(cut)))
    label = row_labels(cut, new)
    representative = np.flatnonzero(first_of_each(label) == np.arange(len(label)))
    representative = representative[np.argsort(label[representative])]
    corners, length = cut.original.copy(), document.entry("accessors", cut.maps[0]["POSITION"])["count"]
    corners[new] = length + label
    values = []
    for attributes, added in zip(cut.maps, cut.values, strict=True):
        columns = {}
        for name, values_there in added.items():
            normalized, old = True, np.full((length, 4), 255, dtype=np.uint8)
            if name in attributes:
                old = read_rows(document, name, attributes[name])
                normalized = document.entry("accessors", attributes[name]).get("normalized", False)
                normalized |= name.startswith("WEIGHTS_")
            if name == "COLOR_0" and deep and old.dtype == np.uint8:
                old = encode(_fractions(old), np.dtype("<u2"), normalized=True)
            rows = encode(values_there[new[representative]], old.dtype, normalized)
            columns[name] = np.concatenate([old, rows])
        values.append({name: columns[name] for name in (*attributes, *(columns.keys() - attributes.keys()))})
    return _Rows(values, corners, values[0]["POSITION"].astype(np.float64), length)


def _fractions(colors: NDArray[Any]) -> Float:
    """Vertex colours as fractions, of normalized integers or floats."""
    return dequantize(colors, {"normalized": True})


class _Vertices:
    """The accessors that cut primitives share: the rows that their triangles use, in spatial order.

    Args:
        editor: that they are added to.
        cut: the primitives.
        table: its rows.
        triangles: (T, 3) rows of ``table``, of each primitive.
        names: the attributes that are kept; all of them if None.
    """

    def __init__(
        self, editor: Builder, cut: CutPrimitives, table: _Rows, triangles: list[Int], names: set[str] | None = None
    ) -> None:
        self._editor, self._local = editor, table.local
        is_used = np.zeros(len(table.local), dtype=bool)
        for part in triangles:
            is_used[part] = True
        used = np.flatnonzero(is_used)
        used = used[morton_order(table.local[used])] if len(used) else used
        self._number = np.full(len(table.local), -1)
        self._number[used] = np.arange(len(used))
        self.maps: list[dict[str, int]] = [
            {
                name: editor.add_attribute(rows[used], attributes[name], name == "POSITION")
                if name in attributes
                else editor.add_accessor(rows[used], "VEC4", normalized=True)
                for name, rows in values.items()
                if names is None or name in names
            }
            for attributes, values in zip(cut.maps, table.values, strict=True)
            if len(used)
        ]

    def primitive(self, source: Primitive, triangles: Int) -> dict[str, Any]:
        """``source`` with other, plain accessors, as a list of ``triangles`` (T, 3) rows of the table; everything
        else about it stays.

        Triangles of a blended material, which viewers draw one by one, stay in their order.
        """
        primitive = source.json | self.bare(source, triangles, in_order=source.is_blended)
        if "mode" in primitive:
            primitive["mode"] = TRIANGLES
        extensions = {name: value for name, value in source.json.get("extensions", {}).items() if name != DRACO}
        if OUTLINE in extensions:
            extensions = kept_outline(self._editor, extensions, self._number)
        primitive.pop("extensions", None)
        return primitive | ({"extensions": extensions} if extensions else {})

    def bare(self, source: Primitive, triangles: Int, in_order: bool = False) -> dict[str, Any]:
        """The properties of a primitive without material that say its geometry: ``triangles`` (T, 3), each from its
        lowest row on, in spatial order, or ``in_order`` as they are."""
        if not in_order:
            a, b, c = (self._local[triangles[:, corner]] for corner in range(3))
            triangles = triangles[morton_order((a + b + c) / 3)]
        indices = self._editor.add_indices(_from_lowest(self._number[triangles]), np.dtype("<u2"))
        geometry: dict[str, Any] = {"attributes": self.maps[0], "indices": indices, "targets": self.maps[1:]}
        first = [key for key in source.json if key in ("indices", "targets")]
        return {key: geometry[key] for key in (*first, "attributes", "indices")}


def _from_lowest(rows: Int) -> Int:
    """Triangles (T, 3) that begin with their lowest row; the winding stays."""
    a, b, c = rows.T
    result, second, third = rows.copy(), (b < a) & (b <= c), (c < a) & (c < b)
    result[second], result[third] = rows[second][:, [1, 2, 0]], rows[third][:, [2, 0, 1]]
    return result


class _Paint:
    """Plain materials of some colours, made at their first use, and primitives with them."""

    def __init__(self, editor: Builder) -> None:
        self._editor = editor
        self._materials: dict[tuple[bool, bool, bool, str], int] = {}
        self._freed: dict[int, int] = {}

    def primitive(
        self, source: Primitive, cut: CutPrimitives, table: _Rows, triangles: Int, style: Style
    ) -> dict[str, Any]:
        """A primitive of ``triangles`` (T, 3), rows of ``table``, without the attributes that only textures need."""
        kept = {name for name in cut.maps[0] if not name.startswith(TEXTURING)}
        for target in cut.maps[1:]:
            if kept.isdisjoint(target):
                kept |= target.keys()  # a morph target must not become empty
        vertices = _Vertices(self._editor, cut, table, [triangles], kept)
        return vertices.bare(source, triangles) | {"material": self._material(source.material, style)}

    def freed(self, ground: Material) -> int:
        """The material without its factor, which vertices have instead."""
        assert ground.index is not None
        if ground.index not in self._freed:
            source = self._editor.json["materials"][ground.index]
            base = source["pbrMetallicRoughness"] | {"baseColorFactor": [1.0, 1.0, 1.0, float(ground.color[3])]}
            self._freed[ground.index] = self._editor.append("materials", source | {"pbrMetallicRoughness": base})
        return self._freed[ground.index]

    def _named(self, ground: Material) -> dict[str, str]:
        """A name such as an editor gives a copy of ``ground``, if that has one."""
        taken = {material.get("name") for material in self._editor.json["materials"]} if ground.name else set()
        number = next(number for number in count(1) if f"{ground.name}.{number:03}" not in taken)
        return {"name": f"{ground.name}.{number:03}"} if ground.name else {}

    def _material(self, ground: Material, style: Style) -> int:
        unlit = ground.unlit
        key = ground.double_sided, unlit, style.glows and not unlit, str(style.color)
        if key not in self._materials:
            self._materials[key] = self._editor.append("materials", self._named(ground) | letter_material(*key))
            used = self._editor.json.get("extensionsUsed", [])
            if unlit and UNLIT not in used:  # a file may use the extension without declaring it
                self._editor.json["extensionsUsed"] = [*used, UNLIT]
        return self._materials[key]


def letter_material(double_sided: bool, unlit: bool, glows: bool, color: str) -> dict[str, Any]:
    """A plain material of the colour ``"#rrggbb"``; one that ``glows`` is black but for its emission."""
    rgb = hex_linear(color).round(6).tolist()
    base = {
        "baseColorFactor": [*([0.0] * 3 if glows else rgb), 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.9 if unlit else 0.6,  # 0.9: what KHR_materials_unlit advises for viewers without it
    }
    material: dict[str, Any] = {"pbrMetallicRoughness": base}
    if glows:
        material["emissiveFactor"] = rgb
    if double_sided:
        material["doubleSided"] = True
    if unlit:
        material["extensions"] = {UNLIT: {}}
    return material


def _replace_primitives(editor: Builder, changes: dict[Owner, dict[int, Replacement]]) -> None:
    """Put the rewritten primitives (by their number) into the meshes of their nodes; an instance becomes a node.

    Nodes that the default scene does not show draw the edited mesh, too.
    """
    json = editor.json
    shown = set(scene_nodes(editor.document)) - hidden_nodes(editor.document)
    drawn = shown | {index for index, _ in changes}
    users: Counter[int] = Counter()
    for node in (json["nodes"][index] for index in drawn):
        if "mesh" in node:
            accessors = instance_attributes(node).values()
            users[node["mesh"]] += max((json["accessors"][number]["count"] for number in accessors), default=1)
    instances: dict[int, dict[int, int]] = {}
    edited: dict[int, int] = {}
    for (index, instance), replaced in sorted(changes.items()):
        node = json["nodes"][index]
        number = _edit_mesh(editor, node["mesh"], replaced, shared=users[node["mesh"]] > 1)
        users[node["mesh"]] -= 1
        edited[node["mesh"]] = number
        if instance is None:
            json["nodes"][index] = node | {"mesh": number}
        else:
            instances.setdefault(index, {})[instance] = number
    for index, node in enumerate(json["nodes"]):
        if index not in drawn and node.get("mesh") in edited:
            json["nodes"][index] = node | {"mesh": edited[node["mesh"]]}
    for index, meshes in instances.items():
        split_off(editor, editor.document, index, meshes)


def _edit_mesh(editor: Builder, index: int, replaced: dict[int, Replacement], shared: bool) -> int:
    """The mesh with some primitives replaced, in its place or, where others draw it too, as a new one."""
    mesh = editor.json["meshes"][index]
    pairs = [replaced.get(number, (primitive, [])) for number, primitive in enumerate(mesh["primitives"])]
    primitives = [base for base, _ in pairs if base] + [painted for _, letters in pairs for painted in letters]
    if not primitives:
        raise ValueError(f"the edit leaves no triangle of meshes[{index}]")
    edited = mesh | {"primitives": primitives}
    if shared:
        return editor.append("meshes", edited)
    editor.json["meshes"][index] = edited
    return index
