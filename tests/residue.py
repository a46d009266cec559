"""What a marked GLB still holds that nothing draws, and in which the clean asset can lie.

Everything is judged by the file itself, but for two questions that need the asset as it was sent: which primitives are
as they were (they may keep what they had), and whether old bytes of those that are not still stand somewhere.
"""

import base64
import binascii
import re
from collections.abc import Iterator
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.glb_file import DRACO, INSTANCING, GlbFile, Json, accessors_of, attribute_maps, meshopt_stream

LEAST = 48  # bytes of an attribute that are no coincidence: four positions


def residue(marked: bytes, original: bytes | None = None) -> list[str]:
    """What is left, a sentence each; empty where there is nothing.

    Args:
        marked: a GLB.
        original: the GLB that it was made of.
    """
    file = GlbFile(marked)
    before = None if original is None else GlbFile(original)
    found = [f"{len(marked) - file.declared} bytes lie behind the GLB"] if len(marked) != file.declared else []
    found += _unreferenced(file)
    found += _dead_bytes(file)
    found += _unused_rows(file, before)
    return found + (_old_bytes(file, before) if before is not None else [])


def _values(node: Any, key: str) -> Iterator[Any]:
    """Every value by that key below a node of JSON."""
    if isinstance(node, dict):
        for name, value in node.items():
            if name == key:
                yield value
            yield from _values(value, key)
    elif isinstance(node, list):
        for value in node:
            yield from _values(value, key)


def drawn_nodes(file: GlbFile) -> set[int]:
    """The nodes that some scene shows, a level of detail of such a node included."""
    scenes = file.entries("scenes")
    nodes = file.entries("nodes")
    pending = [root for scene in scenes for root in scene.get("nodes", [])] if scenes else list(range(len(nodes)))
    found: set[int] = set()
    while pending:
        number = pending.pop()
        if number not in found:
            found.add(number)
            pending += nodes[number].get("children", [])
            pending += nodes[number].get("extensions", {}).get("MSFT_lod", {}).get("ids", [])
    return found


def drawn_meshes(file: GlbFile) -> set[int]:
    nodes = file.entries("nodes")
    return {nodes[number]["mesh"] for number in drawn_nodes(file) if "mesh" in nodes[number]}


def used_accessors(file: GlbFile) -> set[int]:
    """Those of primitives of drawn meshes, skins, animations and instances."""
    nodes = file.entries("nodes")
    used = {skin["inverseBindMatrices"] for skin in file.entries("skins") if "inverseBindMatrices" in skin}
    for number in drawn_meshes(file):
        used.update(*map(accessors_of, file.entries("meshes")[number]["primitives"]))
    for animation in file.entries("animations"):
        used |= {sampler[key] for sampler in animation["samplers"] for key in ("input", "output")}
    for node in nodes:
        used |= set(node.get("extensions", {}).get(INSTANCING, {}).get("attributes", {}).values())
    return used


def used_views(file: GlbFile) -> set[int]:
    """Those of used accessors, of images and of Draco streams."""
    used = {view for number in used_accessors(file) for view in _views(file.entries("accessors")[number])}
    used |= {image["bufferView"] for image in file.entries("images") if "bufferView" in image}
    streams = (primitive.get("extensions", {}).get(DRACO) for primitive in file.primitives())
    return used | {stream["bufferView"] for stream in streams if stream is not None}


def _views(accessor: Json) -> set[int]:
    sparse = accessor.get("sparse", {})
    owners = (accessor, sparse.get("indices", {}), sparse.get("values", {}))
    return {owner["bufferView"] for owner in owners if "bufferView" in owner}


def _unreferenced(file: GlbFile) -> list[str]:
    views = used_views(file)
    placed = [file.entries("bufferViews")[number] for number in views]
    buffers = {place["buffer"] for view in placed for place in (view, meshopt_stream(view)) if place is not None}
    images = {number for texture in file.entries("textures") for number in _values(texture, "source")}
    named = {key: value for key, value in file.json.items() if key not in ("textures", "images", "animations")}
    images |= {number for number in _values(named, "image") if isinstance(number, int)}
    used = {"meshes": drawn_meshes(file), "accessors": used_accessors(file), "bufferViews": views, "buffers": buffers}
    return [
        f"{kind}[{number}] is not used"
        for kind, numbers in (used | {"images": images}).items()
        for number in range(len(file.entries(kind)))
        if number not in numbers
    ]


def covered_bytes(file: GlbFile) -> list[NDArray[np.bool_]]:
    """(B,) of each buffer, which bytes an element of a used accessor, an image or a stream covers."""
    covered = [np.zeros(len(data), bool) for data in file.buffers]
    views = file.entries("bufferViews")

    def cover(place: Json) -> None:
        start = place.get("byteOffset", 0)
        covered[place["buffer"]][start : start + place["byteLength"]] = True

    elements: dict[int, list[tuple[Json, int]]] = {}
    for number in used_accessors(file):
        entry = file.entries("accessors")[number]
        if "bufferView" in entry:
            elements.setdefault(entry["bufferView"], []).append((entry, entry["count"]))
        if (sparse := entry.get("sparse")) is not None:
            index = {**sparse["indices"], "type": "SCALAR"}
            elements.setdefault(index["bufferView"], []).append((index, sparse["count"]))
            what = {"componentType": entry["componentType"], "type": entry["type"], **sparse["values"]}
            elements.setdefault(what["bufferView"], []).append((what, sparse["count"]))
    for number in used_views(file):
        view = views[number]
        stream = meshopt_stream(view)
        if stream is not None:
            cover(stream)
        if number not in elements:
            cover(view)
            continue
        if covered[view["buffer"]].size == 0:  # it only stands for what the stream holds
            continue
        for entry, count in elements[number]:
            stride, step, size, columns = file.layout(entry)
            first = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
            for column in range(columns):
                at = first + column * step + stride * np.arange(count)
                covered[view["buffer"]][(at[:, None] + np.arange(size)).ravel()] = True
    return covered


def _dead_bytes(file: GlbFile) -> list[str]:
    """Bytes of buffers other than 0 that belong to nothing."""
    return [
        f"{dead} bytes of buffers[{number}] belong to nothing"
        for number, (mine, data) in enumerate(zip(covered_bytes(file), file.buffers, strict=True))
        if (dead := int((~mine & (np.frombuffer(data, np.uint8) != 0)).sum()))
    ]


def _unused_rows(file: GlbFile, before: GlbFile | None) -> list[str]:
    """Vertices that no index uses, in accessors that the asset did not have as they are."""
    allowed: dict[str, NDArray[np.bool_]] = {}
    for each in [] if before is None else _used_rows(before).items():
        allowed[_digest(before, each[0])] = ~each[1]  # type: ignore[arg-type]
    found = []
    for number, rows in _used_rows(file).items():
        unused = ~rows & ~allowed.get(_digest(file, number), np.zeros(len(rows), bool))
        if unused.any():
            found.append(f"accessors[{number}] has {int(unused.sum())} rows that no triangle uses")
    return found


def _used_rows(file: GlbFile) -> dict[int, NDArray[np.bool_]]:
    """(N,) by vertex accessor: which of its rows some primitive uses."""
    found: dict[int, NDArray[np.bool_]] = {}
    for primitive in file.primitives():
        rows = file.corners(primitive)
        if primitive.get("mode", 4) == 4:
            rows = rows[: len(rows) // 3 * 3]
        for number in {accessor for each in attribute_maps(primitive) for accessor in each.values()}:
            mask = found.setdefault(number, np.zeros(file.entries("accessors")[number]["count"], bool))
            mask[rows[rows < len(mask)]] = True
    return found


def _digest(file: GlbFile, accessor: int) -> str:
    values = file.read(accessor)
    return sha256(f"{values.dtype}{values.shape}".encode() + values.tobytes()).hexdigest()


def _print(file: GlbFile, primitive: Json) -> str:
    """What tells a primitive from any that draws anything else."""
    maps = [
        sorted((name, _digest(file, number)) for name, number in each.items()) for each in attribute_maps(primitive)
    ]
    return f"{maps} {sha256(file.corners(primitive).tobytes()).hexdigest()}"


def touched(file: GlbFile, before: GlbFile) -> list[Json]:
    """The primitives of the asset that the marked file has no longer as they were."""
    meshes = [file.entries("meshes")[number] for number in drawn_meshes(file)]
    kept = {_print(file, primitive) for mesh in meshes for primitive in mesh["primitives"]}
    return [primitive for primitive in before.primitives() if _print(before, primitive) not in kept]


def _old_bytes(file: GlbFile, before: GlbFile) -> list[str]:
    """What touched primitives had, and that stands somewhere still, whether or not anything refers to it."""
    gone = touched(file, before)
    old = {text: name for primitive in gone for name, text in _texts(before, primitive)}
    # Two primitives may have corners in common: what one that is as it was has, it may keep.
    kept = [text for one in before.primitives() if one not in gone for _, text in _texts(before, one)]
    old = {text: name for text, name in old.items() if not any(text in mine for mine in kept)}
    places = list(_places(file))
    return [f"{name} stands in {place}" for text, name in old.items() for place, data in places if text in data]


def _texts(before: GlbFile, primitive: Json) -> Iterator[tuple[str, bytes]]:
    """The attributes of a primitive as bytes, plain and as they were stored."""
    for which, each in enumerate(attribute_maps(primitive)):
        for name, number in each.items():
            values = before.read(number)
            what = name if which == 0 else f"{name} of target {which - 1}"
            if len(np.unique(values, axis=0)) > 3 and values.nbytes >= LEAST:
                yield f"the old {what} (accessors[{number}])", values.tobytes()
    for number in accessors_of(primitive):
        entry = before.entries("accessors")[number]
        stream = meshopt_stream(before.entries("bufferViews")[entry["bufferView"]]) if "bufferView" in entry else None
        if stream is not None and stream["byteLength"] >= LEAST:
            yield f"the meshopt stream of accessors[{number}]", before.stored(stream)
    if (said := primitive.get("extensions", {}).get(DRACO)) is not None:
        stored = before.stored(before.entries("bufferViews")[said["bufferView"]])
        yield f"the Draco stream in bufferViews[{said['bufferView']}]", stored


def _places(file: GlbFile) -> Iterator[tuple[str, bytes]]:
    """All bytes in which something could stand: buffers without images, the whole JSON, and what it holds encoded."""
    for number, data in enumerate(file.buffers):
        left = bytearray(data)
        for image in file.entries("images"):
            if "bufferView" in image:
                view = file.entries("bufferViews")[image["bufferView"]]
                if view["buffer"] == number:
                    start = view.get("byteOffset", 0)
                    left[start : start + view["byteLength"]] = bytes(view["byteLength"])
        yield f"buffers[{number}]", bytes(left)
    for number, plain in enumerate(file.views):
        if meshopt_stream(file.entries("bufferViews")[number]) is not None:
            yield f"bufferViews[{number}] decoded", plain
    end = len(file.data) if not file.binary else file.data.index(file.binary)
    yield "the JSON", file.data[:end]
    for word in re.findall(rb"[A-Za-z0-9+/]{64,}={0,2}", file.data[:end]):
        try:
            yield "base64 in the JSON", base64.b64decode(word[: len(word) // 4 * 4])
        except binascii.Error:
            continue
