"""Removal of vertex rows that no primitive draws from their accessors."""

import json
from typing import Any

import numpy as np

from core.arrays import Bool, Int
from core.gltf.accessors import read_accessor
from core.gltf.builder import Builder
from core.gltf.compression import DRACO
from core.gltf.references import OUTLINE

Json = dict[str, Any]


def drop_unused_rows(editor: Builder) -> None:
    """Give primitives of an edited document whose accessors hold rows that none draws accessors of their own, with
    the rows they draw in the order and the component types of before.

    These may be rows that a touched primitive shared with them, or that no primitive of the input drew. New accessors
    are passed over, and so are Draco streams, which hold no unused rows.
    """
    rest = [
        primitive
        for mesh in editor.json.get("meshes", [])
        for primitive in mesh["primitives"]
        if "POSITION" in primitive["attributes"]
        and not editor.is_new(primitive["attributes"]["POSITION"])
        and DRACO not in primitive.get("extensions", {})
    ]
    rows = {number: _used_rows(editor, primitive) for number, primitive in enumerate(rest)}
    while cut := _with_unused_rows(rest, rows):
        groups: dict[str, list[int]] = {}
        for number in cut:
            groups.setdefault(_vertex_key(rest[number]), []).append(number)
        for group in groups.values():
            _compact(editor, [rest[number] for number in group], np.logical_or.reduce([rows[n] for n in group]))
            for number in group:
                del rows[number]


def kept_outline(editor: Builder, extensions: Json, number: Int) -> Json:
    """The ``extensions`` of a primitive with its outline (CESIUM_primitive_outline) in new rows: ``number`` (V,) is the
    new one of each row, or -1; lines that lost an end are left out."""
    accessor = extensions[OUTLINE]["indices"]
    lines = number[read_accessor(editor.document, accessor).astype(np.int64).reshape(-1, 2)]
    lines = lines[(lines >= 0).all(axis=1)]
    rest = {name: value for name, value in extensions.items() if name != OUTLINE}
    if not len(lines):
        return rest
    smallest = read_accessor(editor.document, accessor).dtype
    return rest | {OUTLINE: extensions[OUTLINE] | {"indices": editor.add_indices(lines, smallest)}}


def _vertex_key(primitive: Json) -> str:
    return json.dumps([primitive["attributes"], primitive.get("targets")], sort_keys=True)


def _used_rows(editor: Builder, primitive: Json) -> Bool:
    """(V,) the rows that a primitive draws; all of them where it refers to rows that do not exist."""
    count = editor.document.entry("accessors", primitive["attributes"]["POSITION"])["count"]
    if "indices" not in primitive:
        return np.ones(count, dtype=bool)
    indices = read_accessor(editor.document, primitive["indices"])
    used = np.full(count, bool(indices.max() >= count))
    used[np.minimum(indices, count - 1)] = True
    return used


def _with_unused_rows(primitives: list[Json], rows: dict[int, Bool]) -> list[int]:
    """The numbers of the primitives that have an accessor with rows which none of them draws."""
    drawn: dict[int, Bool] = {}
    for number, used in rows.items():
        for accessor in _vertex_accessors(primitives[number]):
            drawn[accessor] = drawn[accessor] | used if accessor in drawn else used
    whole = {accessor for accessor, used in drawn.items() if used.all()}
    return [number for number in rows if not whole.issuperset(_vertex_accessors(primitives[number]))]


def _vertex_accessors(primitive: Json) -> set[int]:
    return set().union(
        *(attributes.values() for attributes in (primitive["attributes"], *primitive.get("targets", [])))
    )


def _compact(editor: Builder, primitives: list[Json], used: Bool) -> None:
    """Replace the accessors of ``primitives``, which share their vertices, by ones of the rows ``used`` (V,)."""
    number = np.where(used, np.cumsum(used) - 1, -1)
    first = primitives[0]
    written: dict[int, int] = {}
    maps = []
    for attributes in (first["attributes"], *first.get("targets", [])):
        for name, accessor in attributes.items():
            if accessor not in written:
                rows = read_accessor(editor.document, accessor)[used]
                written[accessor] = editor.add_attribute(rows, accessor, name == "POSITION")
        maps.append({name: written[accessor] for name, accessor in attributes.items()})
    indices: dict[int, int] = {}
    for primitive in primitives:
        primitive["attributes"] = dict(maps[0])
        if "targets" in primitive:
            primitive["targets"] = [dict(target) for target in maps[1:]]
        if "indices" in primitive:
            accessor = primitive["indices"]
            if accessor not in indices:
                old = read_accessor(editor.document, accessor)
                indices[accessor] = editor.add_indices(number[old.astype(np.int64)], old.dtype)
            primitive["indices"] = indices[accessor]
        if OUTLINE in primitive.get("extensions", {}):
            primitive["extensions"] = kept_outline(editor, primitive["extensions"], number)
            if not primitive["extensions"]:
                del primitive["extensions"]
