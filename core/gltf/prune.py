"""Removal of accessors, buffer views and bytes that an edited GLB no longer refers to."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from core.arrays import Bool
from core.gltf.accessors import read_view
from core.gltf.compression import DRACO, MESHOPT, encode_meshopt, meshopt_of
from core.gltf.document import COMPONENT_TYPES, ELEMENT_TYPES, Document
from core.gltf.references import INSTANCING, LOD, Reference, accessor_references, accessor_views, view_references

Json = dict[str, Any]

ARRAY_BUFFER = 34962


def prune(json: Json, document: Document, payloads: dict[int, bytes]) -> Document:
    """The edited document without unreferenced accessors, buffer views and bytes.

    Unreferenced accessors and buffer views are removed; new ones take their numbers, so that the others keep theirs
    while as many are added as removed. Of a partly referenced view only the referenced bytes are written, compressed
    again where they were. All bytes end up in the BIN chunk, padded with zeros; a fallback buffer of meshopt stays
    while a view refers to it. Unused extensions are removed from both lists. Objects of other kinds keep their numbers,
    used or not: extensions may count them.

    Args:
        json: of the edited document, changed in place; its own.
        document: as it was read; its buffer views are the first of ``json``.
        payloads: the bytes of the views behind these, by number.
    """
    renumber(json, "accessors", len(document.json.get("accessors", [])), accessor_references)
    _cut_views(json, document, payloads)
    old = len(document.json.get("bufferViews", []))
    moved = renumber(json, "bufferViews", old, all_view_references)
    source = {new: number for number, new in moved.items()}
    parts: list[bytes] = []
    offset = 0
    for number, view in enumerate(json.get("bufferViews", [])):
        was = source[number]
        payload = payloads[was] if was in payloads else _stored_bytes(document, was)
        owner = meshopt_of(view) or view
        owner |= {"buffer": 0, "byteOffset": offset}
        padding = -len(payload) % 4
        parts += [payload, bytes(padding)]
        offset += len(payload) + padding
    binary = b"".join(parts)
    _set_buffers(json, document, len(binary))
    _drop_extensions(json)
    return replace(document, json=json, binary=binary)


def unreferenced_bytes(document: Document) -> int:
    """Number of bytes other than 0 in a document's own buffers that nothing refers to; a reference to a view covers
    all of its bytes."""
    views = {container[key] for container, key in all_view_references(document.json)}
    covered: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for number in views:
        view = document.entry("bufferViews", number)
        for part in (view, meshopt_of(view)):
            if part is not None:
                start = part.get("byteOffset", 0)
                covered[part["buffer"]].append((start, start + part["byteLength"]))
    count = 0
    for number, buffer in enumerate(document.json.get("buffers", [])):
        if number and "uri" not in buffer:
            continue  # the fallback of compressed views has no bytes
        data, end = np.frombuffer(document.buffer(number), np.uint8), 0
        for start, stop in [*sorted(covered[number]), (len(data), len(data))]:
            count += int(np.count_nonzero(data[end : max(start, end)]))
            end = max(end, stop)
    used = {container[key] for container, key in accessor_references(document.json)}
    for number, accessor in enumerate(document.json.get("accessors", [])):
        if number not in used and "bufferView" in accessor:
            columns, height = ELEMENT_TYPES[accessor["type"]]
            count += accessor["count"] * columns * height * COMPONENT_TYPES[accessor["componentType"]].itemsize
    return count


def all_view_references(json: Json) -> Iterator[Reference]:
    """Every reference to a buffer view: of accessors, images, Draco streams and other extensions."""
    for accessor in json.get("accessors", []):
        yield from accessor_views(accessor)
    yield from view_references(json)


def renumber(json: Json, kind: str, old: int, references: Callable[[Json], Iterable[Reference]]) -> dict[int, int]:
    """Remove the unreferenced entries of one of the lists of a document's JSON.

    Args:
        json: changed in place.
        kind: name of the list.
        old: entries from here on are new: they first take the numbers of removed older ones.
        references: gives every reference to such an entry; these are renumbered.

    Returns:
        The new number of each entry that stays.
    """
    found = list({(id(container), key): (container, key) for container, key in references(json)}.values())
    used = {container[key] for container, key in found}
    place = {number: number for number in used}
    holes = (number for number in range(old) if number not in used)
    for number, hole in zip(sorted(number for number in used if number >= old), holes, strict=False):
        place[number] = hole
    order = sorted(used, key=place.__getitem__)
    moved = {number: new for new, number in enumerate(order)}
    for container, key in found:
        container[key] = moved[container[key]]
    if order:
        json[kind] = [json[kind][number] for number in order]
    else:
        json.pop(kind, None)
    return moved


def _cut_views(json: Json, document: Document, payloads: dict[int, bytes]) -> None:
    """Give every accessor a view of its own that shares one with unreferenced bytes."""
    whole = {container[key] for container, key in view_references(json)}
    users: dict[int, list[tuple[Json, Json]]] = defaultdict(list)  # view -> accessors, and their parts that lie in it
    for accessor in json.get("accessors", []):
        for part, key in accessor_views(accessor):
            users[part[key]].append((accessor, part))
    for number, found in users.items():
        if number in payloads or number in whole:
            continue
        view = document.entry("bufferViews", number)
        covered = _covered(view, found)
        if covered.all():
            continue
        if meshopt_of(view) is not None:
            _recompress(json, document, payloads, number, covered, [part for _, part in found])
            continue
        written: dict[tuple[Any, ...], int] = {}
        for accessor, part in found:
            count, dtype, shape = _extent(accessor, part)
            offset = part.get("byteOffset", 0)
            place = offset, count, dtype, shape
            if place not in written:
                written[place] = len(json["bufferViews"])
                payload, properties = _plain(document, number, offset, count, dtype, shape)
                json["bufferViews"].append({"buffer": 0, "byteLength": len(payload)} | properties)
                payloads[written[place]] = payload
            part["bufferView"] = written[place]
            part.pop("byteOffset", None)


def _extent(accessor: Json, part: Json) -> tuple[int, np.dtype[Any], tuple[int, int]]:
    """Number, component type and (columns, rows) of the elements in a view: of an accessor, or of its sparse part."""
    count = accessor["count"] if part is accessor else accessor["sparse"]["count"]
    if "componentType" in part and part is not accessor:
        return count, COMPONENT_TYPES[part["componentType"]], (1, 1)
    return count, COMPONENT_TYPES[accessor["componentType"]], ELEMENT_TYPES[accessor["type"]]


def _recompress(
    json: Json, document: Document, payloads: dict[int, bytes], number: int, covered: Bool, parts: list[Json]
) -> None:
    """Compress the rows of a compressed view that are still referred to into a view of their own, and make the
    ``parts`` of accessors refer to it. Without filters, and without rotation of triangles: every byte stays."""
    view = json["bufferViews"][number]
    declared = meshopt_of(view)
    assert declared is not None
    stride, mode = declared["byteStride"], "ATTRIBUTES" if declared["mode"] == "ATTRIBUTES" else "INDICES"
    data, start, length = document.view(number)
    rows = np.where(covered, np.frombuffer(data, np.uint8, length, start), 0).astype(np.uint8).reshape(-1, stride)
    used = covered.reshape(-1, stride).any(axis=1)
    row = np.cumsum(used) - 1
    stream = encode_meshopt(rows[used], mode)
    entry = {key: value for key, value in declared.items() if key not in ("filter", "byteOffset")}
    entry |= {"count": int(used.sum()), "mode": mode, "byteLength": len(stream)}
    name = next(name for name in MESHOPT if name in view["extensions"])
    extensions = view["extensions"] | {name: entry}
    json["bufferViews"].append(view | {"byteLength": int(used.sum()) * stride, "extensions": extensions})
    payloads[len(json["bufferViews"]) - 1] = stream
    for part in parts:
        first, within = divmod(part.get("byteOffset", 0), stride)
        part |= {"bufferView": len(json["bufferViews"]) - 1, "byteOffset": int(row[first]) * stride + within}


def _covered(view: Json, users: Iterable[tuple[Json, Json]]) -> Bool:
    """(byteLength,) the bytes of a view that accessors refer to."""
    covered = np.zeros(view["byteLength"], dtype=bool)
    for accessor, part in users:
        count, dtype, (columns, height) = _extent(accessor, part)
        column = height * dtype.itemsize
        pitch = column if columns == 1 else -(-column // 4) * 4
        stride, offset = view.get("byteStride", columns * pitch), part.get("byteOffset", 0)
        np.ndarray((count, columns, column), bool, covered.data, offset, (stride, pitch, 1))[...] = True
    return covered


def _plain(
    document: Document, view: int, offset: int, count: int, dtype: np.dtype[Any], shape: tuple[int, int]
) -> tuple[bytes, Json]:
    """The elements of an accessor alone, and the properties of a view over them."""
    columns, height = shape
    values = read_view(document, view, offset, count, dtype, shape).reshape(count, columns, height)
    entry = document.entry("bufferViews", view)
    properties = {"target": entry["target"]} if "target" in entry else {}
    padding = -height * dtype.itemsize % 4 // dtype.itemsize
    if padding and (columns > 1 or "byteStride" in entry):  # matrices, and vertex attributes, lie on multiples of four
        values = np.pad(values, ((0, 0), (0, 0), (0, padding)))
        if columns == 1:
            properties["byteStride"] = values.shape[2] * dtype.itemsize
    return values.tobytes(), properties


def _stored_bytes(document: Document, number: int) -> bytes:
    """The bytes of a view as stored in its buffer, compressed or not."""
    view = document.entry("bufferViews", number)
    owner = meshopt_of(view) or view
    start = owner.get("byteOffset", 0)
    return document.buffer(owner["buffer"])[start : start + owner["byteLength"]]


def _set_buffers(json: Json, document: Document, length: int) -> None:
    """One buffer for the BIN chunk, then the fallback buffers that views still refer to."""
    fallbacks = sorted({view["buffer"] for view in json.get("bufferViews", []) if meshopt_of(view) is not None})
    new = {old: number for number, old in enumerate(fallbacks, 1)}
    for view in json.get("bufferViews", []):
        if meshopt_of(view) is not None:
            view["buffer"] = new[view["buffer"]]
    old = document.json.get("buffers", [{}])
    first = {key: value for key, value in old[0].items() if key != "uri"} | {"byteLength": length}
    # The uncompressed copy of a compressed view, for readers without a decoder, is left out.
    rest = [{key: value for key, value in old[number].items() if key != "uri"} for number in fallbacks]
    for buffer in rest:
        extensions = buffer.get("extensions", {})
        if meshopt_of(buffer) is None:
            name = next(name for name in MESHOPT if name in json.get("extensionsUsed", MESHOPT))
            buffer["extensions"] = extensions | {name: {"fallback": True}}
    json["buffers"] = [first, *rest]


def _drop_extensions(json: Json) -> None:
    """Remove the names of unused extensions of geometry from both lists."""
    views, buffers = json.get("bufferViews", []), json.get("buffers", [])
    owners = {
        DRACO: [primitive for mesh in json.get("meshes", []) for primitive in mesh["primitives"]],
        INSTANCING: json.get("nodes", []),
        LOD: json.get("nodes", []) + json.get("materials", []),
        **dict.fromkeys(MESHOPT, views + buffers),
    }
    gone = {name for name, users in owners.items() if not any(name in user.get("extensions", {}) for user in users)}
    for key in ("extensionsUsed", "extensionsRequired"):
        names = [name for name in json.get(key, []) if name not in gone]
        if names:
            json[key] = names
        else:
            json.pop(key, None)
