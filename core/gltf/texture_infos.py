"""The textures that a glTF material names, by whatever property: its own, or one of an extension."""

from collections.abc import Iterator
from typing import Any

from core.gltf.document import Document, malformed, typed

Json = dict[str, Any]


def texture_infos(material: Json) -> Iterator[tuple[Json, str]]:
    """Every textureInfo of a material: the object that has it, and its property."""
    pending: list[Any] = [material]
    while pending:
        value = pending.pop()
        if isinstance(value, list):
            pending += value
            continue
        if not isinstance(value, dict):
            continue
        for key, item in value.items():
            if key.lower().endswith("texture") and isinstance(item, dict) and type(item.get("index")) is int:
                yield value, key
            elif key != "extras":
                pending.append(item)


def uv_sets(document: Document, material: int | None) -> set[int]:
    """The numbers n of the TEXCOORD_n that the textures of a material are looked up by.

    Raises:
        MeshmarkError: ``malformed_file``.
    """
    if material is None:
        return set()
    found: set[int] = set()
    for owner, key in texture_infos(document.entry("materials", material)):
        transform = typed(typed(owner[key], "extensions", dict), "KHR_texture_transform", dict)
        number = transform.get("texCoord", owner[key].get("texCoord", 0))
        if type(number) is not int:
            raise malformed(f"materials[{material}] has a texture whose texCoord is not an integer.")
        found.add(number)
    return found
