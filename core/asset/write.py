"""An edited surface back into its GLB: only what was touched is new, appended behind what was there."""

from collections import Counter
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.asset.appender import Appender
from core.asset.attributes import encode, read_rows
from core.asset.compression import DRACO
from core.asset.edit import Kind, SurfaceEdit
from core.asset.flatten import TRIANGLES, Scene
from core.asset.gltf import Document, read_accessor
from core.asset.instances import instance_attributes, split_off
from core.asset.materials import UNLIT
from core.asset.patch import Patch, cut_patches, primitive_json, row_labels
from core.asset.polygons import hex_linear
from core.asset.settle import primitive_accessors, settle

Int = NDArray[np.int64]
Owner = tuple[int, int | None]  # a node, and which of its instances
Replacement = tuple[dict[str, Any] | None, list[dict[str, Any]]]  # the surface and the coloured letters of a primitive

# What a plain material has no use for, and what would tint it.
TEXTURING = ("TANGENT", "TEXCOORD_", "COLOR_")


def write(
    scene: Scene, edit: SurfaceEdit, colors: Sequence[str | None], glowing: Collection[int] = frozenset()
) -> bytes:
    """The scene's GLB with ``edit`` applied.

    The BIN chunk of the input is the beginning of the output's. A touched primitive gets new accessors, its old rows
    first and unchanged, then the new ones; all other objects stay as they are. A mesh that other nodes draw too is
    cloned for the node that was touched. Same input, same bytes.

    Args:
        scene: what the edit refers to.
        edit: the faces that go and the triangles that come.
        colors: of each mark that ``edit.mark`` counts: ``"#rrggbb"`` puts its caps and walls into a primitive with a
            plain material of that colour; ``None`` leaves them in the source primitive. On unlit sources they are
            unlit.
        glowing: the marks whose colour is given off as light, to be seen on ground that glows; on unlit sources none
            needs to.

    Raises:
        MeshmarkError: ``unsupported_feature`` where a touched vertex cannot be taken back to its node's frame.
    """
    if edit.keep.all() and not len(edit.source_face):
        return scene.document.to_glb()
    appender = Appender(scene.document)
    paint = _Paint(appender)
    painted = np.array([color is not None for color in colors], dtype=bool)
    looks = [(color, number in glowing) for number, color in enumerate(colors)]
    changes: dict[Owner, dict[int, Replacement]] = {}
    replaced: set[int] = set()
    for patch in cut_patches(scene, edit):
        corners, maps = _append_rows(scene.document, patch, appender)
        for index in patch.drawn:
            drawn = scene.primitives[index]
            first = np.searchsorted(scene.surface.face_primitive, index)  # its faces are consecutive, in order
            kept = drawn.triangles[edit.keep[first : first + len(drawn.triangles)]]
            mine = scene.surface.face_primitive[edit.source_face[patch.triangles]] == index
            added = corners.reshape(-1, 3)[mine][:, [0, 2, 1] if drawn.mirrored else [0, 1, 2]]
            mark = edit.mark[patch.triangles][mine]
            letters = (edit.kind[patch.triangles][mine] != Kind.SURFACE) & painted[mark]
            source = primitive_json(scene.document, drawn)
            replaced |= primitive_accessors(source)
            smallest = (
                read_accessor(scene.document, source["indices"]).dtype if "indices" in source else np.dtype("<u2")
            )
            base = np.concatenate([kept, added[~letters]])
            changes.setdefault((drawn.node, drawn.instance), {})[drawn.primitive] = (
                _rewritten(source, maps, appender.add_indices(base, smallest)) if len(base) else None,
                [
                    paint.primitive(source, maps, appender.add_indices(added[letters & wears], smallest), color, glows)
                    for color, glows in dict.fromkeys(looks[number] for number in np.unique(mark[letters]).tolist())
                    if color is not None
                    for wears in (np.isin(mark, [n for n, look in enumerate(looks) if look == (color, glows)]),)
                ],
            )
    replaced |= {
        accessor for node, _ in changes for accessor in instance_attributes(appender.json["nodes"][node]).values()
    }
    _replace_primitives(appender, scene.document, changes)
    settle(appender.json, replaced, scene.document.draco)
    return appender.to_glb()


class _Paint:
    """Plain materials of some colours, made when first needed, and primitives that wear them."""

    def __init__(self, appender: Appender) -> None:
        self._appender = appender
        self._materials: dict[tuple[bool, bool, bool, str], int] = {}

    def primitive(
        self, source: dict[str, Any], maps: list[dict[str, int]], indices: int, color: str, glows: bool
    ) -> dict[str, Any]:
        """A primitive that shares the vertices ``maps`` of ``source``, without what only its textures needed."""
        kept = {name for name in maps[0] if not name.startswith(TEXTURING)}
        for target in maps[1:]:
            if kept.isdisjoint(target):
                kept |= target.keys()  # a morph target must not become empty
        chosen = [{name: accessor for name, accessor in entry.items() if name in kept} for entry in maps]
        painted = {"attributes": chosen[0], "indices": indices, "material": self._material(source, color, glows)}
        return painted | ({"targets": chosen[1:]} if "targets" in source else {})

    def _material(self, source: dict[str, Any], color: str, glows: bool) -> int:
        ground = self._appender.json["materials"][source["material"]] if "material" in source else {}
        double_sided, unlit = bool(ground.get("doubleSided", False)), UNLIT in ground.get("extensions", {})
        key = double_sided, unlit, glows and not unlit, color
        if key not in self._materials:
            self._materials[key] = self._appender.append("materials", letter_material(*key))
            if unlit:
                used = self._appender.json.setdefault("extensionsUsed", [])
                used += [UNLIT] if UNLIT not in used else []
        return self._materials[key]


def letter_material(double_sided: bool, unlit: bool, glows: bool, color: str) -> dict[str, Any]:
    """A plain material of the colour ``"#rrggbb"``; one that ``glows`` is black but for the light it gives off."""
    rgb = hex_linear(color).round(6).tolist()
    base = {
        "baseColorFactor": [*([0.0] * 3 if glows else rgb), 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.9 if unlit else 0.6,  # 0.9: what KHR_materials_unlit advises for viewers without it
    }
    material: dict[str, Any] = {"name": "meshmark", "pbrMetallicRoughness": base}
    if glows:
        material["emissiveFactor"] = rgb
    if double_sided:
        material["doubleSided"] = True
    if unlit:
        material["extensions"] = {UNLIT: {}}
    return material


def _append_rows(document: Document, patch: Patch, appender: Appender) -> tuple[Int, list[dict[str, int]]]:
    """Append the vertex data of a patch: the row (C,) of each corner, and the new accessors in place of its maps."""
    if not len(patch.triangles):
        return patch.original, patch.maps
    new = np.flatnonzero((patch.original < 0) | patch.wall)
    _, representative, label = np.unique(row_labels(patch, new), return_index=True, return_inverse=True)
    corners = patch.original.copy()
    corners[new] = document.entry("accessors", patch.maps[0]["POSITION"])["count"] + label
    maps = []
    for attributes, values in zip(patch.maps, patch.values, strict=True):
        accessors = {}
        for name, accessor in attributes.items():
            entry = document.entry("accessors", accessor)
            rows = read_rows(document, name, accessor)
            normalized = entry.get("normalized", False) or name.startswith("WEIGHTS_")
            added = encode(values[name][new[representative]], rows.dtype, normalized)
            accessors[name] = appender.add_attribute(np.concatenate([rows, added]), entry, name == "POSITION")
        maps.append(accessors)
    return corners, maps


def _rewritten(source: dict[str, Any], maps: list[dict[str, int]], indices: int) -> dict[str, Any]:
    """A primitive with other, plain accessors, as a triangle list; everything else about it stays."""
    primitive = source | {"attributes": maps[0], "indices": indices}
    if "mode" in source:
        primitive["mode"] = TRIANGLES
    if "targets" in source:
        primitive["targets"] = maps[1:]
    extensions = {name: value for name, value in source.get("extensions", {}).items() if name != DRACO}
    if extensions:
        primitive["extensions"] = extensions
    else:
        primitive.pop("extensions", None)
    return primitive


def _replace_primitives(appender: Appender, document: Document, changes: dict[Owner, dict[int, Replacement]]) -> None:
    """Put the rewritten primitives (by their number) into the meshes of their nodes; an instance becomes a node."""
    json = appender.json
    users: Counter[int] = Counter()
    for node in json["nodes"]:
        if "mesh" in node:
            accessors = instance_attributes(node).values()
            users[node["mesh"]] += max((json["accessors"][number]["count"] for number in accessors), default=1)
    instances: dict[int, dict[int, int]] = {}
    for (index, instance), replaced in sorted(changes.items()):
        node = json["nodes"][index]
        number = _edit_mesh(appender, node["mesh"], replaced, shared=users[node["mesh"]] > 1)
        users[node["mesh"]] -= 1
        if instance is None:
            json["nodes"][index] = node | {"mesh": number}
        else:
            instances.setdefault(index, {})[instance] = number
    for index, meshes in instances.items():
        split_off(appender, document, index, meshes)


def _edit_mesh(appender: Appender, index: int, replaced: dict[int, Replacement], shared: bool) -> int:
    """The mesh with some primitives replaced, in its place or, where others draw it too, as a new one."""
    mesh = appender.json["meshes"][index]
    pairs = [replaced.get(number, (primitive, [])) for number, primitive in enumerate(mesh["primitives"])]
    primitives = [base for base, _ in pairs if base] + [painted for _, letters in pairs for painted in letters]
    if not primitives:
        raise ValueError(f"the edit leaves no triangle of meshes[{index}]")
    edited = mesh | {"primitives": primitives}
    if shared:
        return appender.append("meshes", edited)
    appender.json["meshes"][index] = edited
    return index
