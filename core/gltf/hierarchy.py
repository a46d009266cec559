"""The node hierarchy of a glTF document (glTF 2.0 specification, section 3.5)."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from core.arrays import Float
from core.geometry.products import product
from core.gltf.document import Document, malformed, named, typed

VISIBILITY = "KHR_node_visibility"


@dataclass(frozen=True, slots=True)
class Node:
    """A node of a scene.

    Attributes:
        index: glTF index.
        name: empty where the file gives none.
        children: glTF indices.
        mesh, mesh_name: of the mesh that it draws; ``None`` and empty where it draws none.
        skin: glTF index; ``None`` where it has none.
        hidden: KHR_node_visibility hides it, or one above it.
    """

    index: int
    name: str
    children: tuple[int, ...]
    mesh: int | None
    mesh_name: str
    skin: int | None
    hidden: bool

    @property
    def label(self) -> str:
        """The name that viewers show: a node without one goes by that of its mesh."""
        return self.name or self.mesh_name


def read_nodes(document: Document) -> tuple[Node, ...]:
    """The nodes of the default scene, parents before their children: see :func:`scene_nodes`.

    Raises:
        MeshmarkError: ``malformed_file`` for nodes that are not well formed or refer to what does not exist.
    """
    hidden = hidden_nodes(document)
    return tuple(_node(document, index, index in hidden) for index in scene_nodes(document))


def _node(document: Document, index: int, hidden: bool) -> Node:
    entry = document.entry("nodes", index)
    mesh = entry.get("mesh")
    return Node(
        index=index,
        name=named(entry),
        children=tuple(_children(document, index)),
        mesh=mesh,
        mesh_name="" if mesh is None else named(document.entry("meshes", mesh)),
        skin=entry.get("skin"),
        hidden=hidden,
    )


def world_matrices(document: Document) -> Float:
    """(N, 4, 4) local -> world matrix of every node, also of those in no scene.

    Raises:
        MeshmarkError: ``malformed_file`` for a node with two parents, a cycle, or a malformed transform.
    """
    nodes = typed(document.json, "nodes", list)
    worlds = np.zeros((len(nodes), 4, 4))
    parent = np.full(len(nodes), -1)
    for index in range(len(nodes)):
        for child in _children(document, index):
            if parent[child] >= 0:
                raise malformed(f"nodes[{child}] has two parents; a node may have one.")
            parent[child] = index
    pending = [index for index in range(len(nodes)) if parent[index] < 0]
    placed = 0
    while pending:
        index = pending.pop()
        local = _local_matrix(document.entry("nodes", index), index)
        with np.errstate(over="ignore", invalid="ignore"):  # refused just below
            worlds[index] = local if parent[index] < 0 else product(worlds[parent[index]], local)
        pending += _children(document, index)
        placed += 1
    if placed < len(nodes):
        raise malformed("The node hierarchy contains a cycle.")
    if not np.isfinite(worlds).all():
        raise malformed("The transforms of the node hierarchy overflow.")
    return worlds


def scene_nodes(document: Document) -> list[int]:
    """Nodes of the default scene, depth first in file order; every root's where the file has no scenes.

    Raises:
        MeshmarkError: ``malformed_file`` for a scene or node that does not exist, or is listed twice.
    """
    if "scenes" in document.json:
        return nodes_below(document, typed(document.entry("scenes", document.json.get("scene", 0)), "nodes", list))
    count = len(typed(document.json, "nodes", list))
    children = {child for index in range(count) for child in _children(document, index)}
    return nodes_below(document, [index for index in range(count) if index not in children])


def nodes_below(document: Document, roots: list[int]) -> list[int]:
    """``roots`` and everything below them, depth first in file order.

    Raises:
        MeshmarkError: ``malformed_file`` for a node that does not exist, or is met twice.
    """
    pending = roots[::-1]
    found: list[int] = []
    seen: set[int] = set()
    while pending:
        index = pending.pop()
        children_of = _children(document, index)
        if index in seen:
            raise malformed(f"nodes[{index}] appears twice in the scene.")
        seen.add(index)
        found.append(index)
        pending += children_of[::-1]
    return found


def hidden_nodes(document: Document) -> set[int]:
    """Nodes that KHR_node_visibility hides: themselves, or one above them.

    Raises:
        MeshmarkError: ``malformed_file`` for nodes that are not well formed.
    """
    nodes = range(len(typed(document.json, "nodes", list)))
    pending = [node for node in nodes if _is_hidden(document, node)]
    hidden: set[int] = set()
    while pending:
        node = pending.pop()
        if node not in hidden:
            hidden.add(node)
            pending += _children(document, node)
    return hidden


def _is_hidden(document: Document, node: int) -> bool:
    extensions = typed(document.entry("nodes", node), "extensions", dict)
    return typed(extensions, VISIBILITY, dict).get("visible") is False


def _children(document: Document, index: int) -> list[int]:
    children = typed(document.entry("nodes", index), "children", list)
    for child in children:
        document.entry("nodes", child)  # raises where there is none
    return children


def transforms(translation: Float, rotation: Float, scale: Float) -> Float:
    """(N, 4, 4) matrices of (N, 3) translations, (N, 4) quaternions (x, y, z, w) and (N, 3) scales."""
    matrices = np.zeros((len(scale), 4, 4))
    x, y, z, w = rotation.T
    with np.errstate(over="ignore", invalid="ignore"):  # overflowing matrices are refused where they are used
        turned = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        matrices[:, :3, :3] = np.moveaxis(np.array(turned), 2, 0) * scale[:, None]
    matrices[:, :3, 3] = translation
    matrices[:, 3, 3] = 1
    return matrices


def _local_matrix(node: dict[str, Any], index: int) -> Float:
    try:
        if "matrix" in node:
            return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
        translation = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64).reshape(1, 3)
        rotation = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64).reshape(1, 4)
        scale = np.array(node.get("scale", (1, 1, 1)), dtype=np.float64).reshape(1, 3)
    except (TypeError, ValueError):
        raise malformed(f"nodes[{index}] has a malformed transform.") from None
    local: Float = transforms(translation, rotation, scale)[0]
    return local
