"""Instances that a node draws of its mesh (EXT_mesh_gpu_instancing)."""

from typing import Any

import numpy as np

from core.arrays import Float
from core.gltf.accessors import read_accessor, read_values
from core.gltf.builder import Builder
from core.gltf.document import Document, malformed, typed
from core.gltf.hierarchy import transforms
from core.gltf.references import INSTANCING

_PROPERTIES = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}


def instance_attributes(node: dict[str, Any]) -> dict[str, int]:
    """Semantic -> accessor of a node's instances; empty where it draws its mesh once, as any other node."""
    return typed(typed(typed(node, "extensions", dict), INSTANCING, dict), "attributes", dict)


def instance_matrices(document: Document, node: int) -> Float | None:
    """(N, 4, 4) instance -> node matrices, rotations normalised; ``None`` where the node has no instances.

    Raises:
        MeshmarkError: ``malformed_file`` for attributes of another type or of different lengths.
    """
    attributes = instance_attributes(document.entry("nodes", node))
    if not attributes:
        return None
    properties = _properties(document, node, attributes)
    return transforms(properties["TRANSLATION"], properties["ROTATION"], properties["SCALE"])


def split_off(editor: Builder, document: Document, index: int, meshes: dict[int, int]) -> None:
    """Make some instances of a node ordinary children, each with a mesh of its own; the others stay instances.

    Args:
        editor: of the written document; its node is replaced.
        document: as it was read.
        index: the node.
        meshes: instance -> the mesh that it draws from now on.
    """
    node = editor.json["nodes"][index]
    attributes = instance_attributes(node)
    properties = _properties(document, index, attributes)
    kept = np.setdiff1d(np.arange(len(properties["SCALE"])), list(meshes))
    shared = {"weights": node["weights"]} if "weights" in node else {}
    children = [
        editor.append(
            "nodes",
            {"mesh": mesh, **shared} | {key.lower(): values[number].tolist() for key, values in properties.items()},
        )
        for number, mesh in sorted(meshes.items())
    ]
    extensions = {name: value for name, value in node["extensions"].items() if name != INSTANCING or len(kept)}
    if len(kept):
        rows = {
            name: editor.add_attribute(read_accessor(document, accessor)[kept], accessor, bounded=False)
            for name, accessor in attributes.items()
        }
        extensions[INSTANCING] = extensions[INSTANCING] | {"attributes": rows}
    changed = node | {"children": [*node.get("children", []), *children], "extensions": extensions}
    gone = {key for key in ("mesh", "weights") if not len(kept)} | ({"extensions"} if not extensions else set())
    editor.json["nodes"][index] = {key: value for key, value in changed.items() if key not in gone}


def _properties(document: Document, node: int, attributes: dict[str, int]) -> dict[str, Float]:
    """(N, 3) TRANSLATION, (N, 4) unit ROTATION and (N, 3) SCALE."""
    counts = {len(read_accessor(document, accessor)) for accessor in attributes.values()}
    if len(counts) > 1:
        raise malformed(f"The instances that nodes[{node}] draws have attributes of different lengths.")
    count = counts.pop()
    found = {
        "TRANSLATION": np.zeros((count, 3)),
        "ROTATION": np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)),
        "SCALE": np.ones((count, 3)),
    }
    for name, width in _PROPERTIES.items():
        if name in attributes:
            values = read_values(document, attributes[name])
            if values.shape != (count, width) or not np.isfinite(values).all():
                raise malformed(f"The {name} of the instances that nodes[{node}] draws is not {width} finite numbers.")
            found[name] = values
    length = np.linalg.norm(found["ROTATION"], axis=1, keepdims=True)
    if not length.all():
        raise malformed(f"An instance that nodes[{node}] draws has no rotation.")
    found["ROTATION"] = found["ROTATION"] / length
    return found
