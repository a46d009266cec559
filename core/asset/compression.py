"""Geometry that a GLB stores compressed, decoded: KHR_draco_mesh_compression and EXT/KHR_meshopt_compression.

The native decoders are imported on first use, inside the engine: whoever only looks at headers does not load them.
Both check their input against its end and raise on damage; what they might miss ends a worker's child, not the
service.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.asset.refusals import malformed

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
# The Draco bitstream, section 3: what precedes the counts.
_DRACO_HEADER_BYTES, _DRACO_METADATA_FLAG = 11, 0x8000


def meshopt_of(entry: dict[str, Any]) -> dict[str, Any] | None:
    """What a buffer view or a buffer says about its meshopt compression; ``None`` where it has none."""
    extensions = entry.get("extensions", {})
    return next((extensions[name] for name in MESHOPT if name in extensions), None)


def decode_meshopt(data: bytes, declared: dict[str, Any], where: str) -> bytes:
    """The ``count * byteStride`` plain bytes of a compressed buffer view, its filter undone.

    Args:
        data: the compressed bytes.
        declared: the extension object of the view: ``mode``, ``count``, ``byteStride`` and perhaps ``filter``.
        where: names the view in errors.

    Raises:
        MeshmarkError: ``malformed_file`` where the bytes are not what ``declared`` says.
    """
    import meshopt

    try:
        decoded = meshopt.decode_gltf_buffer(
            data, declared["count"], declared["byteStride"], declared["mode"], declared.get("filter")
        )
    except (KeyError, TypeError, ValueError, RuntimeError, OverflowError):
        raise malformed(f"The compressed bytes of {where} are damaged: they cannot be decoded.") from None
    plain = np.ascontiguousarray(decoded).tobytes()
    if len(plain) != declared["count"] * declared["byteStride"]:
        raise malformed(f"{where} decodes to {len(plain):,} bytes, which is not what it declares.")
    return plain


def decode_draco(data: bytes, faces: int, where: str) -> tuple[NDArray[np.uint32], dict[int, NDArray[Any]]]:
    """The mesh in a Draco stream.

    Args:
        data: the stream.
        faces: how many triangles the file declares; a stream that claims others is refused before it is decoded.
        where: names the stream in errors.

    Returns:
        (3 * faces,) indices, and (V, n) values of each attribute by its unique id.

    Raises:
        MeshmarkError: ``malformed_file``.
    """
    import DracoPy

    claimed = _draco_faces(data)
    if claimed is not None and claimed != faces:
        raise malformed(f"{where} holds {claimed:,} triangles, but its accessor declares {faces:,}.")
    try:
        mesh = DracoPy.decode(bytes(data))
        indices = np.asarray(mesh.faces, dtype=np.uint32).reshape(-1)
        attributes = {int(entry["unique_id"]): np.asarray(entry["data"]) for entry in mesh.attributes}
    except (DracoPy.FileTypeException, AttributeError, TypeError, ValueError, RuntimeError, OverflowError, MemoryError):
        raise malformed(f"{where} is damaged: it cannot be decoded as a Draco mesh.") from None
    if indices.size != 3 * faces:
        raise malformed(f"{where} decodes to {indices.size // 3:,} triangles, but its accessor declares {faces:,}.")
    return indices, attributes


def _draco_faces(data: bytes) -> int | None:
    """The triangles that the head of a Draco stream claims; ``None`` where metadata stand before the number."""
    head = bytes(data[: _DRACO_HEADER_BYTES + 16])
    if len(head) < _DRACO_HEADER_BYTES + 2 or int.from_bytes(head[9:11], "little") & _DRACO_METADATA_FLAG:
        return None
    is_edgebreaker = head[8] == 1
    numbers: list[int] = []
    at = _DRACO_HEADER_BYTES + is_edgebreaker
    while len(numbers) < 2:  # of an edgebreaker stream: vertices, faces; of a sequential one: faces, points
        number = shift = 0
        while at < len(head):
            number |= (head[at] & 0x7F) << shift
            shift, at = shift + 7, at + 1
            if not head[at - 1] & 0x80:
                break
        numbers.append(number)
    return numbers[is_edgebreaker]
