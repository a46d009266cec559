"""Checks of a GLB's declarations of compressed geometry; nothing is decoded here, and no decoder is loaded."""

from typing import Any

from core.errors import ErrorCode, MeshmarkError
from core.gltf.compression import DRACO, MESHOPT, meshopt_of
from core.gltf.declarations import Json, entries, integer, mapping, quote, reference
from core.gltf.document import malformed

TRIANGLES = 4
# mode -> filter -> the strides it can have (EXT_meshopt_compression, "JSON schema updates"; COLOR is KHR's)
_ROWS, _SHORT_ROWS = range(4, 257, 4), (4, 8)
_STRIDES: dict[str, dict[str, Any]] = {
    "ATTRIBUTES": {
        "NONE": _ROWS,
        "OCTAHEDRAL": _SHORT_ROWS,
        "QUATERNION": (8,),
        "EXPONENTIAL": _ROWS,
        "COLOR": _SHORT_ROWS,
    },
    "TRIANGLES": {"NONE": (2, 4)},
    "INDICES": {"NONE": (2, 4)},
}


def check_fallback(buffer: Json, number: int) -> bool:
    """True for a fallback buffer: it represents the decoded bytes of compressed views, and has none itself.

    Raises:
        MeshmarkError: ``malformed_file``; ``unsupported_feature`` where it is in the place of the BIN chunk.
    """
    where = f"buffers[{number}]"
    extensions = mapping(buffer, "extensions", where)
    declared = [mapping(extensions, name, where) for name in MESHOPT]
    is_fallback = any(extension.get("fallback", False) is True for extension in declared)
    if is_fallback and number == 0:
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FEATURE,
            "The first buffer of the GLB holds no bytes of its own; only a later one may.",
            "Compress the asset with gltfpack, or send it without meshopt compression.",
        )
    return is_fallback and "uri" not in buffer


def check_meshopt(view: Json, json: Json, buffers: list[bytes], where: str) -> int:
    """The bytes that a compressed buffer view decodes to.

    Args:
        view: the buffer view; its own byte range is sound.
        json: of the GLB.
        buffers: the bytes of each buffer, empty for a fallback.
        where: names the view in errors.

    Raises:
        MeshmarkError: ``malformed_file`` for contradictory declarations.
    """
    where = f"{where}.extensions"
    if len(view["extensions"].keys() & set(MESHOPT)) > 1:
        raise malformed(f"{where} compresses the view twice.")
    declared = meshopt_of(view)
    if not isinstance(declared, dict):
        raise malformed(f"{where} does not say how the view is compressed.")
    buffer = reference(declared.get("buffer"), json, "buffers", where)
    end = integer(declared, "byteOffset", where, 0) + integer(declared, "byteLength", where, least=1)
    if end > len(buffers[buffer]):
        raise malformed(f"{where} ends at byte {end:,} of buffers[{buffer}], which has {len(buffers[buffer]):,}.")
    count, stride = integer(declared, "count", where, least=1), integer(declared, "byteStride", where, least=1)
    mode, name = declared.get("mode"), declared.get("filter", "NONE")
    filters = _STRIDES.get(mode) if isinstance(mode, str) else None
    strides = filters.get(name) if filters is not None and isinstance(name, str) else None
    if strides is None:
        raise malformed(f"{where} has mode {quote(mode)} and filter {quote(name)}, which do not exist together.")
    if stride not in strides or (mode == "TRIANGLES" and count % 3):
        raise malformed(f"{where} declares {count:,} rows of {stride} bytes, which {mode} with {name} cannot be.")
    if count * stride != view["byteLength"] or view.get("byteStride", stride) != stride:
        raise malformed(
            f"{where} decodes to {count:,} rows of {stride} bytes, but the view declares {view['byteLength']:,} bytes."
        )
    return count * stride


def check_draco(primitive: Json, json: Json, where: str) -> None:
    """Refuse a Draco primitive whose stream, attributes or indices contradict its declarations.

    Raises:
        MeshmarkError: ``malformed_file``; ``unsupported_feature`` for a strip.
    """
    extensions = mapping(primitive, "extensions", where)
    if DRACO not in extensions:
        return
    extension, where = mapping(extensions, DRACO, where), f"{where}, {DRACO},"
    reference(extension.get("bufferView"), json, "bufferViews", where)
    numbers = mapping(extension, "attributes", where)
    for name in numbers:
        integer(numbers, name, f"{where} attributes")
    if not numbers or not numbers.keys() <= primitive["attributes"].keys():
        raise malformed(f"{where} does not name attributes of its primitive.")
    indices = entries(json, "accessors")[reference(primitive.get("indices"), json, "accessors", where)]
    if primitive.get("mode", TRIANGLES) != TRIANGLES:
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FEATURE,
            f"{where} is not a triangle list; Draco streams are read as triangle lists only.",
            f"Export the asset without {DRACO} and send it again.",
        )
    if indices["count"] % 3:
        raise malformed(f"{where} has {indices['count']:,} indices, which are no whole triangles.")
