"""Geometry that a GLB stores compressed, decoded: KHR_draco_mesh_compression and EXT/KHR_meshopt_compression.

The native decoders are imported on first use, inside the engine: reading headers does not load them. Both check their
input against its end and raise on damage; damage that they might miss ends a worker's child, not the service.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.refusals import malformed

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_DRACO_2_2 = b"DRACO\2\2"
_DRACO_HEADER_BYTES, _DRACO_METADATA_FLAG, _DRACO_METADATA_LIMIT = 11, 0x8000, 10_000


def meshopt_of(entry: dict[str, Any]) -> dict[str, Any] | None:
    """The meshopt extension object of a buffer view or a buffer; ``None`` where it has none."""
    extensions = entry.get("extensions", {})
    return next((extensions[name] for name in MESHOPT if name in extensions), None)


def decode_meshopt(data: bytes, declared: dict[str, Any], where: str) -> bytes:
    """The ``count * byteStride`` plain bytes of a compressed buffer view, its filter undone.

    Args:
        data: the compressed bytes.
        declared: the extension object of the view: ``mode``, ``count``, ``byteStride`` and perhaps ``filter``.
        where: names the view in errors.

    Raises:
        MeshmarkError: ``malformed_file`` where the bytes are not as ``declared``.
    """
    import meshopt

    try:
        decoded = meshopt.decode_gltf_buffer(
            data, declared["count"], declared["byteStride"], declared["mode"], declared.get("filter")
        )
    except Exception:  # whatever a native library raises, it is about this file
        raise malformed(f"The compressed bytes of {where} are damaged: they cannot be decoded.") from None
    plain = np.ascontiguousarray(decoded).tobytes()
    if len(plain) != declared["count"] * declared["byteStride"]:
        raise malformed(f"{where} decodes to {len(plain):,} bytes, which is not what it declares.")
    return plain


def encode_meshopt(rows: NDArray[np.uint8], mode: str) -> bytes:
    """The compressed bytes of (N, stride) plain rows: "ATTRIBUTES", or "INDICES" of two or four bytes each."""
    import meshopt

    indices = rows.view(f"<u{rows.shape[1]}")[:, 0] if mode == "INDICES" else rows
    return bytes(meshopt.encode_gltf_buffer(indices, mode, 0))


def decode_draco(data: bytes, faces: int, where: str) -> tuple[NDArray[np.uint32], dict[int, NDArray[Any]]]:
    """The mesh in a Draco stream.

    Args:
        data: the stream.
        faces: number of triangles that the file declares; a stream that declares another is refused before it is
            decoded, for a few kilobytes can hold millions.
        where: names the stream in errors.

    Returns:
        (3 * faces,) indices, and (V, n) values of each attribute by its unique id.

    Raises:
        MeshmarkError: ``malformed_file``.
    """
    import DracoPy

    claimed = _draco_faces(data, where)
    if claimed != faces:
        raise malformed(f"{where} holds {claimed:,} triangles, but its accessor declares {faces:,}.")
    try:
        mesh = DracoPy.decode(data)
        indices = np.asarray(mesh.faces, dtype=np.uint32).reshape(-1)
        attributes = {int(entry["unique_id"]): np.asarray(entry["data"]) for entry in mesh.attributes}
    except Exception:  # whatever a native library raises, it is about this file
        raise malformed(f"{where} is damaged: it cannot be decoded as a Draco mesh.") from None
    if indices.size != 3 * faces:
        raise malformed(f"{where} decodes to {indices.size // 3:,} triangles, but its accessor declares {faces:,}.")
    return indices, attributes


def _draco_faces(data: bytes, where: str) -> int:
    """The number of triangles that a Draco stream declares (Draco bitstream specification, sections 4 and 5)."""
    if data[:7] != _DRACO_2_2:
        raise malformed(f"{where} is not in version 2.2 of the Draco format, the one that a glTF may contain.")
    head = _DracoHead(data, where)
    if int.from_bytes(data[9:11], "little") & _DRACO_METADATA_FLAG:
        head.skip_metadata()
    if data[8:9] != b"\1":  # sequential: faces, points
        return head.number()
    head.skip(1)  # edgebreaker: how it is traversed, vertices, faces
    head.number()
    return head.number()


class _DracoHead:
    """A cursor over the head of a Draco stream."""

    def __init__(self, data: bytes, where: str) -> None:
        self._data, self._where, self._at = data, where, _DRACO_HEADER_BYTES

    def skip(self, count: int) -> None:
        self._at += count

    def byte(self) -> int:
        if self._at >= len(self._data):
            raise malformed(f"{self._where} ends inside its head.")
        self._at += 1
        return self._data[self._at - 1]

    def number(self) -> int:
        """An integer of seven bits a byte, the lowest first."""
        value = 0
        for shift in range(0, 35, 7):
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise malformed(f"{self._where} has a number in its head that is too long.")

    def skip_metadata(self) -> None:
        """The metadata of each attribute, then that of the whole: names, values and nested metadata."""
        left = _DRACO_METADATA_LIMIT
        for attribute in range(self.number() + 1, 0, -1):
            if attribute > 1:
                self.number()  # its identifier
            pending, nested = 1, False
            while pending:
                if nested:
                    self.skip(self.byte())  # a name
                entries = self.number()
                left -= entries + 1
                if left < 0:
                    raise malformed(f"{self._where} has more than {_DRACO_METADATA_LIMIT:,} entries of metadata.")
                for _ in range(entries):
                    self.skip(self.byte())
                    self.skip(self.number())
                pending += self.number() - 1
                nested = True
