"""A document with fewer triangles: rows of its vertex attributes are left out, and none is changed."""

import json
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from core.arrays import Float, Int
from core.geometry.decimation import Corners, decimate
from core.geometry.grouping import group_rows
from core.geometry.products import cross
from core.geometry.triangles import unit
from core.gltf.accessors import dequantize, read_accessor, read_values
from core.gltf.builder import Builder
from core.gltf.compression import DRACO
from core.gltf.document import Document
from core.gltf.primitives import DrawnPrimitive, Primitive
from core.gltf.references import OUTLINE
from core.gltf.scene import Scene
from core.gltf.shown import forget, without
from core.gltf.texture_infos import uv_sets

Json = dict[str, Any]

# A colour from black to white counts as this many size-30 units, and a distance on a texture as this share of that on
# the surface, where these are the mean of a primitive. Ours.
COLOR, UV = 1.0, 0.5
# Only shading depends on these, and new triangles take what suits them of those at their corners.
SHADING = ("POSITION", "NORMAL", "TANGENT")


def fewer_triangles(scene: Scene, target: int) -> tuple[Document, int]:
    """The document of a scene with at most ``target`` triangles, counted as they are drawn, where that can be.

    All primitives of all meshes are decimated at once (:func:`core.geometry.decimation.decimate`), as they stand in the
    scene: triangles go where they are missed least, and most go from what is small or even. Every vertex that is left
    has the attributes, joints, weights and morph targets that it had.

    Args:
        scene: that draws each of its meshes, and nothing else is in its document.
        target: triangles.

    Returns:
        The document, and how many triangles it draws.
    """
    parts = _parts(scene)
    corners, rows = _corners(scene, parts)
    faces, source = decimate(corners, target)
    editor = Builder(scene.document)
    first = np.cumsum([0, *(len(part.primitive.triangles) for part in parts)])
    which = np.searchsorted(first, source, side="right") - 1
    groups: dict[str, list[tuple[Primitive, Int]]] = {}
    for number, part in enumerate(parts):
        mine = which == number
        triangles = rows.of(scene.document, part.primitive, faces[mine])
        if not len(triangles):  # of nothing but triangles without area; a mesh needs one
            triangles = part.primitive.triangles[:1]
        key = json.dumps([part.primitive.mesh, part.primitive.attributes, part.primitive.targets], sort_keys=True)
        groups.setdefault(key, []).append((part.primitive, triangles))
    for group in groups.values():
        _write(editor, group)
    forget(editor.json, OUTLINE)
    return editor.to_document(), int(corners.draws[source].sum())


@dataclass(frozen=True, eq=False)
class _Part:
    """A primitive where it is drawn first, and how often it is drawn."""

    drawn: DrawnPrimitive
    draws: int

    @property
    def primitive(self) -> Primitive:
        return self.drawn.primitive


def _parts(scene: Scene) -> list[_Part]:
    draws = Counter((each.primitive.mesh, each.primitive.number) for each in scene.primitives)
    found: dict[tuple[int, int], _Part] = {}
    for each in scene.primitives:
        key = each.primitive.mesh, each.primitive.number
        found.setdefault(key, _Part(each, draws[key]))
    return list(found.values())


@dataclass(frozen=True, eq=False)
class _Rows:
    """The accessor rows that each corner stands for: ``row[first[c] : first[c + 1]]`` of corner c."""

    row: Int
    first: Int

    def of(self, document: Document, primitive: Primitive, corners: Int) -> Int:
        """(T, 3) rows of triangles (T, 3) of corners; of several, those whose normal is most like the triangle's."""
        flat = corners.ravel()
        rows = self.row[self.first[flat]]
        count = self.first[flat + 1] - self.first[flat]
        several = np.flatnonzero(count > 1)
        if "NORMAL" not in primitive.attributes or not len(several):
            return np.asarray(rows.reshape(-1, 3))
        place = read_values(document, primitive.attributes["POSITION"])
        normals = read_values(document, primitive.attributes["NORMAL"])
        a, b, c = (place[rows.reshape(-1, 3)[:, corner]] for corner in range(3))
        facing = unit(cross(b - a, c - a))[several // 3]
        owner = np.repeat(np.arange(len(several)), count[several])
        start = np.cumsum(count[several]) - count[several]
        options = self.row[self.first[flat[several]][owner] + np.arange(len(owner)) - start[owner]]
        likeness = np.einsum("oi,oi->o", normals[options], facing[owner])
        order = np.lexsort((options, -likeness, owner))
        rows[several] = options[order][start]
        return np.asarray(rows.reshape(-1, 3))


def _corners(scene: Scene, parts: list[_Part]) -> tuple[Corners, _Rows]:
    """The corners of all parts. Rows at one place that differ in their shading alone are one corner."""
    document, surface = scene.document, scene.surface
    has_uv = any(uv is not None for part in parts if (uv := _texture_uv(part.primitive)) is not None)
    has_color = any("COLOR_0" in part.primitive.attributes for part in parts)
    point, values, faces, row, label = [], [], [], [], []
    known = 0
    for part in parts:
        used, triangles = np.unique(part.primitive.triangles, return_inverse=True)
        at = part.drawn.first_vertex + used
        weld = surface.weld[at]
        classes = group_rows(np.hstack([weld[:, None].astype(np.uint32), *_words(document, part.primitive, used)]))
        where = np.unique(classes, return_index=True)[1]
        columns = [surface.positions[at]]
        if has_uv:
            columns.append(_scaled_uv(document, part.primitive, used, triangles.reshape(-1, 3), columns[0]))
        if has_color:
            columns.append(_colors(document, part.primitive, used))
        point.append(weld[where])
        values.append(np.hstack(columns)[where])
        faces.append(known + classes[triangles.reshape(-1, 3)])
        row.append(used)
        label.append(known + classes)
        known += len(where)
    # Corners ascend by their points, and have the rows of one of them side by side.
    points = np.unique(np.concatenate(point), return_inverse=True)[1]
    order = np.argsort(points, kind="stable")
    rank = np.empty(known, dtype=np.int64)
    rank[order] = np.arange(known)
    labels = rank[np.concatenate(label)]
    sorted_rows = np.concatenate(row)[np.argsort(labels, kind="stable")]
    draws = np.repeat([part.draws for part in parts], [len(part.primitive.triangles) for part in parts])
    corners = Corners(rank[np.concatenate(faces)], points[order], np.concatenate(values)[order], draws)
    return corners, _Rows(sorted_rows, np.searchsorted(np.sort(labels), np.arange(known + 1)))


def _words(document: Document, primitive: Primitive, used: Int) -> list[np.ndarray[Any, np.dtype[np.uint32]]]:
    """(U, k) words that are equal for the rows ``used`` (U,) whose attributes are, those of shading left aside."""
    sets = uv_sets(document, primitive.material.index)
    words = []
    for number, attributes in enumerate(primitive.maps):
        for name, accessor in attributes.items():
            unused = name.startswith("TEXCOORD_") and int(name.removeprefix("TEXCOORD_")) not in sets
            if (name in SHADING and not (number and name == "POSITION")) or unused:
                continue
            rows = read_accessor(document, accessor)
            stored = np.ascontiguousarray(rows.reshape(len(rows), -1)[used])
            stored = stored + stored.dtype.type(0)  # -0.0 is 0.0
            raw = stored.view(np.uint8).reshape(len(used), -1)
            padded = np.pad(raw, ((0, 0), (0, -raw.shape[1] % 4)))
            words.append(np.ascontiguousarray(padded).view(np.uint32))
    return words


def _texture_uv(primitive: Primitive) -> int | None:
    """The accessor of the coordinates of the base colour's texture; None where there is none."""
    material = primitive.material
    return None if material.texture is None else primitive.attributes.get(f"TEXCOORD_{material.uv_set}")


def _scaled_uv(document: Document, primitive: Primitive, used: Int, triangles: Int, places: Float) -> Float:
    """(U, 2) texture coordinates of the rows ``used``, in the units of their ``places`` (U, 3)."""
    accessor = _texture_uv(primitive)
    if accessor is None:
        return np.zeros((len(used), 2))
    uv = np.nan_to_num(read_values(document, accessor)[used], posinf=0.0, neginf=0.0)
    a, b, c = (uv[triangles[:, corner]] for corner in range(3))
    flat = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum()
    p, q, r = (places[triangles[:, corner]] for corner in range(3))
    area = np.linalg.norm(cross(q - p, r - p), axis=1).sum()
    return np.asarray(uv * (UV * np.sqrt(area / flat) if flat > 0 and np.isfinite(flat) else 0.0))


def _colors(document: Document, primitive: Primitive, used: Int) -> Float:
    """(U, 3) colours of the rows ``used``, from 0 to ``COLOR``."""
    if "COLOR_0" not in primitive.attributes:
        return np.zeros((len(used), 3))
    accessor = primitive.attributes["COLOR_0"]
    colors = dequantize(read_accessor(document, accessor)[used], document.entry("accessors", accessor))
    return np.asarray(COLOR * np.clip(np.nan_to_num(colors[:, :3]), 0, 1))


def _write(editor: Builder, group: list[tuple[Primitive, Int]]) -> None:
    """Give primitives that share their vertex attributes the triangles (T, 3) of each, and no other rows."""
    first, document = group[0][0], editor.document
    used = np.unique(np.concatenate([triangles.ravel() for _, triangles in group]))
    written: dict[int, int] = {}
    maps = []
    for attributes in first.maps:
        for name, accessor in attributes.items():
            if accessor not in written:
                rows = read_accessor(document, accessor)[used]
                written[accessor] = editor.add_attribute(rows, accessor, name == "POSITION")
        maps.append({name: written[accessor] for name, accessor in attributes.items()})
    for primitive, triangles in group:
        entry = editor.json["meshes"][primitive.mesh]["primitives"][primitive.number]
        entry["attributes"] = dict(maps[0])
        if "targets" in entry:
            entry["targets"] = [dict(target) for target in maps[1:]]
        entry["indices"] = editor.add_indices(np.searchsorted(used, triangles), np.dtype("<u2"))
        entry.pop("mode", None)
        without(entry, DRACO)
        without(entry, OUTLINE)
