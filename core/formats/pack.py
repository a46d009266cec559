"""A glTF with its buffers and images in other files, or in data URIs, as one GLB document."""

from collections.abc import Callable
from typing import Any

from core.budgets import Budgets
from core.formats.archive import Archive, outside
from core.formats.source import Source
from core.gltf.data_uri import decode_data_uri, is_data_uri
from core.gltf.document import Document, malformed, parse_json, typed
from core.gltf.images import mime_type
from core.gltf.validate import check_document, check_json_text, check_version

Json = dict[str, Any]
Load = Callable[[str], bytes | None]

_ALIGNMENT = 8  # bytes; a multiple of the largest component of accessors


def check_gltf(source: Source, budgets: Budgets) -> Document:
    """A .gltf packed, and refused where its declarations contradict each other, its bytes or the budgets.

    Raises:
        MeshmarkError: as :func:`core.gltf.validate.check_glb`.
    """
    if source.archive is None:
        document = pack_json(source.data, budgets)
    else:
        document = pack_archive(source.data, source.archive, source.name, budgets)
    check_document(document, budgets)
    return document


def pack_archive(data: bytes, archive: Archive, name: str, budgets: Budgets) -> Document:
    """A .gltf that came in an archive under a ``name``, with the files it refers to; an image that is missing stays a
    URI.

    Buffers become the BIN chunk, images buffer views with their very bytes; all else of the JSON is carried.

    Raises:
        MeshmarkError: ``malformed_file``, ``external_reference`` or ``budget_exceeded``.
    """

    def load(uri: str) -> bytes | None:
        found = archive.find(uri, name)
        return None if found is None else archive.read(found)

    def load_image(uri: str) -> bytes | None:
        found = archive.locate(uri, name)
        return load(uri) if found is None else archive.read(found)

    return _pack(data, name, load, load_image, budgets)


def pack_json(data: bytes, budgets: Budgets) -> Document:
    """A .gltf on its own: its buffers and images are data URIs.

    Raises:
        MeshmarkError: ``malformed_file``, ``budget_exceeded``, or ``external_reference`` for buffers in other files.
    """
    return _pack(data, "The glTF", lambda _uri: None, lambda _uri: None, budgets)


def _pack(text: bytes, name: str, load: Load, load_image: Load, budgets: Budgets) -> Document:
    text = text.removeprefix(b"\xef\xbb\xbf")
    check_json_text(text, budgets)
    document = Document(parse_json(text), b"")
    check_version(document.json)
    binary = bytearray()
    _pack_buffers(document, binary, name, load)
    _pack_images(document, binary, load_image)
    if binary:
        buffers = document.json["buffers"]
        buffers[0]["byteLength"] = len(binary)
    document.binary = bytes(binary)
    return document


def _pack_buffers(document: Document, binary: bytearray, name: str, load: Load) -> None:
    """Concatenate all buffers with a URI into the first one; those without (fallbacks of extensions) follow it."""
    packed: list[Json] = []
    kept: list[Json] = []
    place: list[tuple[int, int]] = []  # of each old buffer: its new number, and the offset of its first byte in there
    buffers = typed(document.json, "buffers", list)
    for number in range(len(buffers)):
        buffer = document.entry("buffers", number)
        uri = buffer.get("uri")
        if uri is None:
            kept.append(buffer)
            place.append((len(kept), 0))
            continue
        content = _content(uri, load, f"buffers[{number}]")
        if content is None:
            raise outside(uri, name)
        declared = buffer.get("byteLength")
        if type(declared) is not int or not 0 < declared <= len(content):
            raise malformed(f"buffers[{number}] declares {declared!r} bytes, but its file has {len(content):,}.")
        binary += bytes(-len(binary) % _ALIGNMENT)
        place.append((0, len(binary)))
        binary += content[:declared]
        packed.append({key: value for key, value in buffer.items() if key != "uri"})
    if buffers:
        first = packed[0] if len(packed) == 1 else {"byteLength": 0}
        document.json["buffers"] = [first, *kept]
    for number in range(len(typed(document.json, "bufferViews", list))):
        view = document.entry("bufferViews", number)
        for owner in (view, *(value for value in typed(view, "extensions", dict).values() if isinstance(value, dict))):
            _move(owner, place)


def _move(owner: Json, place: list[tuple[int, int]]) -> None:
    """Update the buffer and offset of a buffer view, or of an extension in it that names a buffer."""
    buffer, offset = owner.get("buffer"), owner.get("byteOffset", 0)
    if type(buffer) is not int or not 0 <= buffer < len(place) or type(offset) is not int:
        return  # refused by the gate, or no buffer at all
    owner["buffer"], start = place[buffer]
    if start + offset or "byteOffset" in owner:
        owner["byteOffset"] = start + offset


def _pack_images(document: Document, binary: bytearray, load: Load) -> None:
    views = typed(document.json, "bufferViews", list)
    stored: dict[bytes, int] = {}
    for number in range(len(typed(document.json, "images", list))):
        image = document.entry("images", number)
        uri = image.get("uri")
        if uri is None:
            continue
        content = document.image(number) if is_data_uri(uri) else _content(uri, load, f"images[{number}]")
        if not content:
            continue  # carried as it is: the file may be beside the result, and nothing else needs the picture
        content = bytes(content)
        if not document.json.setdefault("buffers", []):
            document.json["buffers"].append({"byteLength": 0})
        if content not in stored:
            binary += bytes(-len(binary) % _ALIGNMENT)
            stored[content] = len(views)
            views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(content)})
            binary += content
        del image["uri"]
        image["bufferView"] = stored[content]
        image["mimeType"] = mime_type(content) or image.get("mimeType", "application/octet-stream")
    if views:
        document.json["bufferViews"] = views


def _content(uri: Any, load: Load, where: str) -> bytes | None:
    """The bytes behind a URI; ``None`` where the file is not in the upload."""
    if not isinstance(uri, str):
        raise malformed(f"The URI of {where} is not a text.")
    if not is_data_uri(uri):
        return load(uri)
    try:
        return decode_data_uri(uri)
    except ValueError:
        raise malformed(f"The data URI of {where} cannot be decoded.") from None
