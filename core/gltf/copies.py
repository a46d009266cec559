"""Copies of the asset beside its default scene: other scenes, levels of detail, nodes and meshes that no scene shows.

With only the default scene marked, they hold the unmarked asset.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

from core.gltf.builder import Builder
from core.gltf.document import Document, typed
from core.gltf.hierarchy import hidden_nodes, nodes_below, scene_nodes
from core.gltf.prune import renumber
from core.gltf.references import INSTANCING, LOD
from core.gltf.scene import Scene, flatten

Json = dict[str, Any]
CopyKind = Literal["hidden_nodes", "level_of_detail", "scene", "unused_nodes", "unused_meshes"]

COVERAGE = "MSFT_screencoverage"


@dataclass(frozen=True)
class Copy:
    """Nodes with meshes that the default scene does not show, or the meshes that no node draws.

    Attributes:
        kind: what holds them; hidden nodes are those of the default scene.
        name: of the scene, or of the level's node; empty where it has none.
        nodes: those with a mesh that no earlier copy has, ascending.
        root: the level's node; ``None`` for other kinds.
        of: the node that the level replaces.
    """

    kind: CopyKind
    name: str
    nodes: tuple[int, ...]
    root: int | None = None
    of: int | None = None


def find_copies(document: Document) -> list[Copy]:
    """All copies with meshes beside those that the default scene shows: its hidden nodes, levels of detail, other
    scenes, nodes and meshes in no scene, each in the order of the file.

    Raises:
        MeshmarkError: ``malformed_file``.
    """
    hidden = hidden_nodes(document)
    taken = set(scene_nodes(document)) - hidden
    nodes = typed(document.json, "nodes", list)
    found: list[Copy] = []

    def add(kind: CopyKind, name: Any, members: list[int], **more: int) -> None:
        mine = tuple(sorted(node for node in members if node not in taken and "mesh" in nodes[node]))
        taken.update(members)
        if mine:
            found.append(Copy(kind, name if isinstance(name, str) else "", mine, **more))

    add("hidden_nodes", "", [node for node in scene_nodes(document) if node in hidden])
    for owner in range(len(nodes)):
        for root in _levels(document, owner):
            add("level_of_detail", nodes[root].get("name"), nodes_below(document, [root]), root=root, of=owner)
    for scene in typed(document.json, "scenes", list):
        add("scene", scene.get("name"), nodes_below(document, typed(scene, "nodes", list)))
    add("unused_nodes", "", list(range(len(nodes))))
    if unused := unused_meshes(document):
        names = [document.entry("meshes", mesh).get("name") for mesh in unused]
        found.append(Copy("unused_meshes", ", ".join(name for name in names if isinstance(name, str)), ()))
    return found


def unused_meshes(document: Document) -> list[int]:
    """The meshes that no node draws and no extension refers to."""
    used = {container[key] for container, key in _mesh_references(document.json)}
    return [mesh for mesh in range(len(document.json.get("meshes", []))) if mesh not in used]


def scene_of(document: Document, copy: Copy) -> Scene:
    """The surface of a copy alone, a level of detail in the place of the node that it replaces.

    Raises:
        MeshmarkError: as :func:`core.gltf.scene.flatten`.
    """
    nodes = [
        node if index in copy.nodes else {key: value for key, value in node.items() if key != "mesh"}
        for index, node in enumerate(document.json["nodes"])
    ]
    roots = set(range(len(nodes))) - {child for node in nodes for child in node.get("children", [])}
    if copy.root is not None and copy.root in roots:
        parents = [index for index, node in enumerate(nodes) if copy.of in node.get("children", [])]
        for parent in parents:  # at most one
            nodes[parent] = nodes[parent] | {"children": [*nodes[parent]["children"], copy.root]}
            roots -= {copy.root}
    shown = document.json | {"nodes": nodes, "scenes": [{"nodes": sorted(roots)}], "scene": 0}
    return replace(flatten(replace(document, json=shown)), document=document)


def leave_out(document: Document, copies: Collection[Copy]) -> Document:
    """The document without the meshes of some copies: their nodes stay, but draw nothing, and levels of detail are
    removed from their nodes."""
    editor = Builder(document)
    nodes = editor.json["nodes"]
    bare = {node for copy in copies for node in copy.nodes}
    for number in bare:
        node = nodes[number]
        for key in ("mesh", "skin", "weights"):
            node.pop(key, None)
        _drop_extension(node, INSTANCING)
    for copy in copies:
        if copy.of is not None and copy.root is not None:
            _drop_level(nodes[copy.of], copy.root)
    _drop_weight_channels(editor.json, bare)
    renumber(editor.json, "meshes", len(editor.json["meshes"]), _mesh_references)
    return editor.to_document()


def _levels(document: Document, owner: int) -> list[int]:
    extensions = typed(document.entry("nodes", owner), "extensions", dict)
    levels = typed(typed(extensions, LOD, dict), "ids", list)
    for level in levels:
        document.entry("nodes", level)  # raises where there is none
    return levels


def _mesh_references(json_: Json) -> Iterator[tuple[Json, str]]:
    """Every reference to a mesh: of nodes, and the ``mesh`` properties of extensions, as of avatars and colliders."""
    for node in json_.get("nodes", []):
        if "mesh" in node:
            yield node, "mesh"
    pending: list[Any] = [json_.get("extensions", {}), *(node.get("extensions", {}) for node in json_.get("nodes", []))]
    while pending:
        value = pending.pop()
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, item in items:
            if key == "mesh" and type(item) is int:
                yield value, key
            elif isinstance(item, dict | list):
                pending.append(item)


def _drop_level(node: Json, level: int) -> None:
    """Remove one level of detail from a node, with its entry of the screen coverages."""
    extension = node["extensions"][LOD]
    place = extension["ids"].index(level)
    extension["ids"] = [number for number in extension["ids"] if number != level]
    coverage = node.get("extras", {}).get(COVERAGE) if isinstance(node.get("extras"), dict) else None
    if isinstance(coverage, list) and len(coverage) > place + 1:
        del coverage[place + 1]  # the first is of the node itself
    if not extension["ids"]:
        _drop_extension(node, LOD)


def _drop_extension(owner: Json, name: str) -> None:
    extensions = owner.get("extensions", {})
    extensions.pop(name, None)
    if not extensions:
        owner.pop("extensions", None)


def _drop_weight_channels(json_: Json, nodes: Collection[int]) -> None:
    """Remove the animations of morph weights of nodes without a mesh, and animations left without channels."""
    for animation in json_.get("animations", []):
        animation["channels"] = [
            channel
            for channel in animation["channels"]
            if channel["target"].get("path") != "weights" or channel["target"].get("node") not in nodes
        ]
    animations = [animation for animation in json_.get("animations", []) if animation["channels"]]
    if animations:
        json_["animations"] = animations
    else:
        json_.pop("animations", None)
