"""What an edited GLB no longer uses of its compression and instancing extensions, taken back."""

from collections.abc import Collection
from typing import Any

from core.asset.compression import DRACO, MESHOPT, meshopt_of
from core.asset.instances import INSTANCING, instance_attributes

Json = dict[str, Any]

_BYTES = ("bufferView", "byteOffset", "sparse", "min", "max")


def primitive_accessors(primitive: Json) -> set[int]:
    """The accessors of a mesh primitive: its indices, its attributes and those of its morph targets."""
    indices = {primitive["indices"]} if "indices" in primitive else set()
    return indices.union(
        primitive["attributes"].values(), *(target.values() for target in primitive.get("targets", []))
    )


def settle(json: Json, replaced: set[int], streamed: Collection[int]) -> None:
    """Make ``extensionsUsed`` and ``extensionsRequired`` say no more than what the edited file still needs.

    An accessor that was replaced and that nothing refers to any more loses its bytes; a compressed buffer view behind
    such accessors only becomes a plain one over the compressed bytes; a fallback buffer without buffer views goes.

    Args:
        json: of the edited GLB, changed in place; its entries are replaced, not changed.
        replaced: the accessors of the primitives and instances that were replaced.
        streamed: the accessors whose bytes are in Draco streams; without these they are zeros, which need no bounds.
    """
    unused = replaced - _used_accessors(json)
    accessors = json["accessors"]
    needed = {view for number, entry in enumerate(accessors) if number not in unused for view in _views(entry)}
    needed |= {image["bufferView"] for image in json.get("images", []) if "bufferView" in image}
    released = {view for number in unused for view in _views(accessors[number])} - needed
    released = {view for view in released if meshopt_of(json["bufferViews"][view]) is not None}
    for number in unused:
        entry = accessors[number]
        if number in streamed or released & _views(entry):
            accessors[number] = {key: value for key, value in entry.items() if key not in _BYTES}
    for view in released:
        json["bufferViews"][view] = _plain(json["bufferViews"][view])
    _drop_fallbacks(json)
    _drop_names(json)


def _used_accessors(json: Json) -> set[int]:
    used = {skin["inverseBindMatrices"] for skin in json.get("skins", []) if "inverseBindMatrices" in skin}
    for mesh in json["meshes"]:
        used.update(*map(primitive_accessors, mesh["primitives"]))
    for animation in json.get("animations", []):
        used.update(sampler[key] for sampler in animation.get("samplers", []) for key in ("input", "output"))
    for node in json["nodes"]:
        used.update(instance_attributes(node).values())
    return used


def _views(accessor: Json) -> set[int]:
    """The buffer views behind an accessor."""
    sparse = accessor.get("sparse", {})
    owners = (accessor, sparse.get("indices", {}), sparse.get("values", {}))
    return {owner["bufferView"] for owner in owners if "bufferView" in owner}


def _plain(view: Json) -> Json:
    """A buffer view over the compressed bytes of a compressed one."""
    compressed = meshopt_of(view)
    assert compressed is not None
    extensions = {name: value for name, value in view["extensions"].items() if name not in MESHOPT}
    kept = {key: value for key, value in view.items() if key in ("name", "extras")}
    place = {"buffer": compressed["buffer"], "byteOffset": compressed.get("byteOffset", 0)}
    return place | {"byteLength": compressed["byteLength"]} | kept | ({"extensions": extensions} if extensions else {})


def _drop_fallbacks(json: Json) -> None:
    """Remove the buffers that only stood for decoded bytes and that no buffer view refers to any more."""
    owners = [owner for view in json["bufferViews"] for owner in (view, meshopt_of(view)) if owner is not None]
    used = {owner["buffer"] for owner in owners}
    kept = [n for n, buffer in enumerate(json["buffers"]) if n in used or meshopt_of(buffer) is None]
    if len(kept) == len(json["buffers"]):
        return
    new = {old: number for number, old in enumerate(kept)}
    json["buffers"] = [json["buffers"][number] for number in kept]
    json["bufferViews"] = [_renumbered(view, new) for view in json["bufferViews"]]


def _renumbered(view: Json, new: dict[int, int]) -> Json:
    renumbered = view | {"buffer": new[view["buffer"]]}
    if "extensions" in view:
        renumbered["extensions"] = {
            name: value | {"buffer": new[value["buffer"]]} if name in MESHOPT else value
            for name, value in view["extensions"].items()
        }
    return renumbered


def _drop_names(json: Json) -> None:
    """Take the names of the extensions that nothing uses any more out of both lists."""
    owners = {
        DRACO: [primitive for mesh in json["meshes"] for primitive in mesh["primitives"]],
        INSTANCING: json["nodes"],
        **dict.fromkeys(MESHOPT, json["bufferViews"] + json["buffers"]),
    }
    gone = {name for name, users in owners.items() if not any(name in user.get("extensions", {}) for user in users)}
    for key in ("extensionsUsed", "extensionsRequired"):
        names = [name for name in json.get(key, []) if name not in gone]
        if names:
            json[key] = names
        else:
            json.pop(key, None)
