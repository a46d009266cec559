"""A document with nothing in it but what its default scene draws as triangles."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from core.gltf.builder import Builder
from core.gltf.copies import Copy, find_copies, leave_out
from core.gltf.document import Document
from core.gltf.references import LOD
from core.gltf.scene import flatten

Json = dict[str, Any]

VARIANTS = "KHR_materials_variants"


def only_shown(document: Document) -> tuple[Document, list[str]]:
    """The document without other scenes, levels of detail, hidden nodes and unused meshes, without points, lines and
    other meshes that :func:`core.gltf.scene.flatten` leaves out, and without other materials than those that are drawn:
    variants, levels of detail and unused ones; without chunks that nobody has looked into.

    Nodes keep their numbers, and those of what is left out draw nothing; materials keep theirs, and those that are left
    out are empty.

    Returns:
        The document, and what its default scene draws but is left out, in words.

    Raises:
        MeshmarkError: as :func:`core.gltf.scene.flatten`.
    """
    drawn: dict[int, set[int]] = {}
    nodes = set()
    for each in flatten(document).primitives:
        if not each.node.hidden:
            nodes.add(each.node.index)
            drawn.setdefault(each.primitive.mesh, set()).add(each.primitive.number)
    copies = find_copies(document)
    gone = {node for copy in copies for node in copy.nodes}
    bare = tuple(
        number
        for number, node in enumerate(document.json["nodes"])
        if "mesh" in node and number not in nodes and number not in gone
    )
    left_out = [f"nodes[{number}]" for number in bare]
    editor = Builder(document)
    for number, mesh in enumerate(editor.json["meshes"]):
        kept = drawn.get(number, set(range(len(mesh["primitives"]))))
        left_out += [f"meshes[{number}].primitives[{k}]" for k in range(len(mesh["primitives"])) if k not in kept]
        mesh["primitives"] = [primitive for k, primitive in enumerate(mesh["primitives"]) if k in kept]
    document = leave_out(editor.to_document(), [*copies, Copy("hidden_nodes", "", bare)])
    editor = Builder(document)
    if "scenes" in editor.json:
        editor.json["scenes"] = [editor.json["scenes"][editor.json.get("scene", 0)]]
        editor.json["scene"] = 0
    _leave_out_materials(editor.json)
    return replace(editor.to_document(), chunks=()), left_out


def _leave_out_materials(json: Json) -> None:
    primitives = [primitive for mesh in json["meshes"] for primitive in mesh["primitives"]]
    materials = json.get("materials", [])
    for owner in (json, *primitives):
        without(owner, VARIANTS)
    used = {primitive["material"] for primitive in primitives if "material" in primitive}
    for number, material in enumerate(materials):
        if number in used:
            without(material, LOD)
        else:
            materials[number] = {}
    forget(json, VARIANTS, LOD)


def without(owner: Json, name: str) -> None:
    """Remove an extension of an object, if it is there."""
    extensions = owner.get("extensions", {})
    extensions.pop(name, None)
    if not extensions:
        owner.pop("extensions", None)


def forget(json: Json, *names: str) -> None:
    """Remove the ``names`` of extensions from both lists of a document's JSON where nothing has them any more."""
    gone = set(names) - set(_extensions(json))
    for key in ("extensionsUsed", "extensionsRequired"):
        kept = [name for name in json.get(key, []) if name not in gone]
        if kept:
            json[key] = kept
        else:
            json.pop(key, None)


def _extensions(json: Json) -> Iterator[str]:
    pending: list[Any] = [json]
    while pending:
        value = pending.pop()
        if isinstance(value, dict):
            if isinstance(value.get("extensions"), dict):
                yield from value["extensions"]
            pending += value.values()
        elif isinstance(value, list):
            pending += value
