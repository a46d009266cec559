"""References of a glTF's JSON to its accessors and buffer views, extensions included."""

from collections.abc import Iterator
from typing import Any

Json = dict[str, Any]
Reference = tuple[Json, str]  # an object, and its property that holds the number

INSTANCING, LOD, OUTLINE = "EXT_mesh_gpu_instancing", "MSFT_lod", "CESIUM_primitive_outline"
# Extensions whose properties name buffer views by other words than `bufferView` (EXT_structural_metadata; its
# predecessor EXT_feature_metadata).
_METADATA = ("values", "arrayOffsets", "stringOffsets", "arrayOffsetBufferView", "stringOffsetBufferView")
_OWN = ("accessors", "bufferViews", "buffers", "images")  # whose references are listed by name


def accessor_references(json: Json) -> Iterator[Reference]:
    """Every reference to an accessor: of primitives, skins, animations, instances and outlines."""
    for mesh in json.get("meshes", []):
        for primitive in mesh["primitives"]:
            yield from primitive_references(primitive)
    for skin in json.get("skins", []):
        if "inverseBindMatrices" in skin:
            yield skin, "inverseBindMatrices"
    for animation in json.get("animations", []):
        for sampler in animation.get("samplers", []):
            yield from ((sampler, key) for key in ("input", "output") if key in sampler)
    for node in json.get("nodes", []):
        attributes = node.get("extensions", {}).get(INSTANCING, {}).get("attributes", {})
        yield from ((attributes, name) for name in attributes)


def primitive_references(primitive: Json) -> Iterator[Reference]:
    """The references of a mesh primitive: its indices, its attributes and those of its morph targets."""
    if "indices" in primitive:
        yield primitive, "indices"
    for attributes in (primitive["attributes"], *primitive.get("targets", [])):
        yield from ((attributes, name) for name in attributes)
    outline = primitive.get("extensions", {}).get(OUTLINE, {})
    if "indices" in outline:
        yield outline, "indices"


def view_references(json: Json) -> Iterator[Reference]:
    """Every reference to a buffer view that is not an accessor's: of images, Draco streams and other extensions.

    The ``bufferView`` properties of unknown extensions count.
    """
    yield from ((image, "bufferView") for image in json.get("images", []) if "bufferView" in image)
    yield from _within({key: value for key, value in json.items() if key not in _OWN}, metadata=False)


def accessor_views(accessor: Json) -> Iterator[Reference]:
    """The references of an accessor to buffer views: its own, and those of its sparse part."""
    sparse = accessor.get("sparse", {})
    owners = (accessor, sparse.get("indices", {}), sparse.get("values", {}))
    yield from ((owner, "bufferView") for owner in owners if "bufferView" in owner)


def _within(value: Any, metadata: bool) -> Iterator[Reference]:
    pending = [(value, metadata)]
    while pending:
        value, metadata = pending.pop()
        if isinstance(value, list):
            pending += [(item, metadata) for item in value if isinstance(item, dict | list)]
            continue
        for key, item in value.items():
            if type(item) is int:
                if key == "bufferView" or (metadata and key in _METADATA):
                    yield value, key
            elif isinstance(item, dict | list):
                pending.append((item, metadata or key in ("EXT_structural_metadata", "EXT_feature_metadata")))
