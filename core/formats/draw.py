"""Draws a scene as exports have it: the parts of its nodes, and the looks of its materials."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from core.arrays import Bool, Float
from core.formats.drawing import NEUTRAL, WHITE, Drawing, Look, Part, Rgba, bytes_of
from core.geometry.products import product
from core.gltf.accessors import read_values
from core.gltf.attributes import Points
from core.gltf.base_color import base_color
from core.gltf.colors import hex_srgb
from core.gltf.document import Document, typed
from core.gltf.images import mime_type
from core.gltf.materials import Material
from core.gltf.primitives import DrawnPrimitive
from core.gltf.scene import Scene
from core.gltf.textures import ReadTexture, texture_reader
from core.refusals import no_faces

MOST_LOOKS = 256  # looks that colours of letters may add before vertices have to carry them

_ENDINGS = {"image/png": "png", "image/jpeg": "jpg", "image/webp": "webp"}


def draw(scene: Scene, *, vertex_colors: bool = False) -> Drawing:
    """The parts of a scene at its default pose: what hidden nodes draw is left out.

    Colours that vertices have become looks of their own where each face has one colour, as those of letters do: more
    formats and more programs know materials than vertex colours.

    Args:
        scene: of the result.
        vertex_colors: keep colours in the vertices.

    Raises:
        MeshmarkError: ``no_faces`` where all nodes are hidden.
    """
    looks = _Looks(scene.document)
    parts = [
        _part(scene, list(drawn), looks)
        for _, drawn in groupby(
            (item for item in scene.primitives if not item.node.hidden), key=lambda item: (item.node, item.instance)
        )
    ]
    if not parts:
        raise no_faces("Hidden nodes alone draw something in this asset: there is nothing to export.")
    drawing = Drawing([part for part, _ in parts], looks.looks, looks.images, [*_left_out(scene), *looks.left_out])
    if vertex_colors:
        return drawing
    return _painted(scene.document, drawing, [rows for _, rows in parts]) or drawing


@dataclass(frozen=True, eq=False)
class _Rows:
    """The drawn primitives of a part, the first face of each in it, and the row at which its accessors begin."""

    drawn: list[DrawnPrimitive]
    face: list[int]
    row: list[int]


def _part(scene: Scene, drawn: list[DrawnPrimitive], looks: "_Looks") -> tuple[Part, _Rows]:
    document, first = scene.document, drawn[0]
    shapes = {_shape(item): item for item in drawn}
    deformed = first.skin is not None or any(item.morph_weights.any() for item in drawn)
    rows: dict[tuple[int, int, bytes], int] = {}
    positions, count = [], 0
    for shape, item in shapes.items():
        values = read_values(document, item.primitive.attributes["POSITION"])
        if deformed:
            values = scene.surface.positions[item.first_vertex : item.first_vertex + len(values)]
            values = scene.surface.to_world(values)
        rows[shape] = count
        positions.append(values)
        count += len(values)
    sizes = [len(values) for values in positions]
    turned = [0, 2, 1] if deformed and first.mirrored else [0, 1, 2]
    faces = [item.triangles[:, turned] + rows[_shape(item)] for item in drawn]
    uvs = [_uv(document, item) for item in shapes.values()]
    normals = [None if deformed else _attribute(document, item, "NORMAL", 3) for item in shapes.values()]
    colors = [_attribute(document, item, "COLOR_0", 3) for item in shapes.values()]
    part = Part(
        name=first.node.label,
        node=first.node.index,
        mesh=first.primitive.mesh if not deformed else -1 - first.node.index,
        matrix=np.eye(4) if deformed else np.vstack([first.matrices[0], [0, 0, 0, 1]]),
        positions=np.concatenate(positions),
        faces=np.concatenate(faces),
        look=np.repeat(
            [looks.number(item.primitive.material, "COLOR_0" in item.primitive.attributes) for item in drawn],
            [len(part) for part in faces],
        ),
        normals=_stacked(normals, sizes, 3, np.nan),
        uv=_stacked(uvs, sizes, 2, np.nan),
        colors=_stacked([None if item is None else _rgba(item) for item in colors], sizes, 4, 1.0),
    )
    starts = np.cumsum([0, *map(len, faces)])[:-1].tolist()
    return part, _Rows(drawn, starts, [rows[_shape(item)] for item in drawn])


def _shape(drawn: DrawnPrimitive) -> tuple[int, int, bytes]:
    """Equal for primitives that share their vertices, and the UVs that their textures are drawn by."""
    material = drawn.primitive.material
    return drawn.first_vertex, material.uv_set, material.uv_transform.tobytes()


def _attribute(document: Document, drawn: DrawnPrimitive, name: str, width: int) -> Float | None:
    if (accessor := drawn.primitive.attributes.get(name)) is None:
        return None
    values = read_values(document, accessor)
    return values if values.shape[1] >= width else None


def _uv(document: Document, drawn: DrawnPrimitive) -> Float | None:
    """Texture coordinates as the base colour's texture is drawn by, its transform applied."""
    material = drawn.primitive.material
    values = _attribute(document, drawn, f"TEXCOORD_{material.uv_set}", 2)
    if values is None or np.array_equal(material.uv_transform, np.eye(2, 3)):
        return values
    return np.asarray(product(values[:, :2], material.uv_transform[:, :2].T) + material.uv_transform[:, 2])


def _rgba(colors: Float) -> Float:
    opaque = np.ones((len(colors), 4 - colors.shape[1]))
    return np.asarray(np.clip(np.nan_to_num(np.column_stack([colors, opaque])), 0, 1))


def _stacked(values: list[Float | None], sizes: list[int], width: int, missing: float) -> Float | None:
    if all(item is None for item in values):
        return None
    return np.concatenate(
        [np.full((size, width), missing) if item is None else item for item, size in zip(values, sizes, strict=True)]
    )


class _Looks:
    """The looks of a document's materials, each made at its first use."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._numbers: dict[tuple[int | None, bool], int] = {}
        self._images: dict[int, int] = {}
        self.looks: list[Look] = []
        self.images: list[tuple[str, bytes]] = []
        self.left_out: list[str] = []

    def number(self, material: Material, colored: bool) -> int:
        """The number of the look of a material; the default one is none, or white where vertices are ``colored``."""
        key = material.index, colored and material.index is None
        if key not in self._numbers:
            self._numbers[key] = len(self.looks)
            default = Look(color=WHITE if colored else NEUTRAL)
            self.looks.append(default if material.index is None else self._look(material))
        return self._numbers[key]

    def _look(self, material: Material) -> Look:
        entry = self._document.entry("materials", material.index)
        surface = typed(entry, "pbrMetallicRoughness", dict)
        red, green, blue, alpha = np.clip(np.nan_to_num(material.color), 0, 1).tolist()
        emissive = np.zeros(3) if material.emission is None else np.clip(material.emission.color, 0, 1)
        normal = typed(entry, "normalTexture", dict).get("index")
        for use in ("metallicRoughnessTexture", "occlusionTexture", "emissiveTexture"):
            if use in entry or use in surface:
                self._lose(f"textures of {_WORDS[use]}")
        return Look(
            name=material.name,
            color=(red, green, blue, alpha if material.alpha_mode == "BLEND" else 1.0),
            image=None if material.texture is None else self._image(material.texture),
            normal_map=self._image(normal) if type(normal) is int else None,
            metallic=_fraction(surface.get("metallicFactor", 1.0)),
            roughness=_fraction(surface.get("roughnessFactor", 1.0)),
            emissive=(float(emissive[0]), float(emissive[1]), float(emissive[2])),
            masked=material.alpha_mode == "MASK",
        )

    def _image(self, texture: int) -> int | None:
        """The number of a texture's image; None where it is of no kind that other formats refer to."""
        entry = self._document.entry("textures", texture)
        sources = [entry.get("source")]
        sources += [extension.get("source") for extension in typed(entry, "extensions", dict).values()]
        for source in sources:
            if type(source) is not int:
                continue
            if source in self._images:
                return self._images[source]
            data = self._document.image(source)
            if data is not None and (ending := _ENDINGS.get(mime_type(data) or "")):
                self._images[source] = len(self.images)
                self.images.append((ending, bytes(data)))
                return self._images[source]
        self._lose("textures that are no PNG, JPEG or WebP in the file")
        return None

    def _lose(self, what: str) -> None:
        if what not in self.left_out:
            self.left_out.append(what)


_WORDS = {
    "metallicRoughnessTexture": "metal and roughness",
    "occlusionTexture": "occlusion",
    "emissiveTexture": "emission",
}


def _fraction(value: Any) -> float:
    return float(np.clip(value, 0, 1)) if isinstance(value, int | float) else 1.0


def _left_out(scene: Scene) -> Iterator[str]:
    """Contents of a document that no format but glTF holds, in words."""
    json = scene.document.json
    meshes = [mesh for mesh in typed(json, "meshes", list) if isinstance(mesh, dict)]
    primitives = [item for mesh in meshes for item in typed(mesh, "primitives", list)]
    names = {name for item in primitives for name in item.get("attributes", {})}
    found = {
        "animations": bool(json.get("animations")),
        "skins": bool(json.get("skins")),
        "morph targets": any(item.get("targets") for item in primitives),
        "further UV sets": "TEXCOORD_1" in names,
        "further vertex colours": "COLOR_1" in names,
        "further scenes": len(typed(json, "scenes", list)) > 1,
        "hidden nodes": any(node.hidden and node.mesh is not None for node in scene.nodes),
        "points and lines": any(item.get("mode", 4) < 4 for item in primitives),
        "cameras": bool(json.get("cameras")),
        "lights": "KHR_lights_punctual" in typed(json, "extensions", dict),
    }
    return (what for what, there in found.items() if there)


def _painted(document: Document, drawing: Drawing, rows: list[_Rows]) -> Drawing | None:
    """The drawing with a look for each colour that faces have of their vertices; None where faces have several."""
    looks, numbers = list(drawing.looks), dict[tuple[int, int], int]()
    read = texture_reader(document)
    parts = []
    for part, of in zip(drawing.parts, rows, strict=True):
        if part.colors is None:
            parts.append(part)
            continue
        words = bytes_of(part.colors).view("<u4")[:, 0].astype(np.int64)
        corners = words[part.faces]
        if not (corners == corners[:, :1]).all():
            return None
        pairs, first, which, sizes = np.unique(
            part.look << 32 | corners[:, 0], return_index=True, return_inverse=True, return_counts=True
        )
        if len(numbers) + len(pairs) > MOST_LOOKS:
            return None
        keys = [(pair >> 32, pair & 0xFFFFFFFF) for pair in pairs.tolist()]
        ground = {number: word for _, (number, word) in sorted(zip(sizes.tolist(), keys, strict=True))}
        ground |= {number: word for number, word in keys if word == _WHITE_WORD}
        chosen = np.empty(len(pairs), dtype=np.int64)
        for place, key in enumerate(keys):
            if key[1] == _WHITE_WORD:
                chosen[place] = key[0]
                continue
            if key not in numbers:
                numbers[key], look = len(looks), looks[key[0]]
                tinted = _fourfold(np.array(look.color) * part.colors[part.faces[first[place], 0]])
                named = look.name if ground[key[0]] == key[1] else f"{look.name} {_hex(tinted)}".strip()
                if look.image is not None and _is_point(part, which.reshape(-1) == place):
                    tinted = _seen(document, of, int(first[place]), part, read)
                    look = replace(look, image=None, normal_map=None, masked=False)
                    named = f"{look.name} {_hex(tinted)}".strip()
                looks.append(replace(look, name=named, color=tinted))
            chosen[place] = numbers[key]
        parts.append(replace(part, look=chosen[which.reshape(-1)], colors=None))
    return replace(drawing, parts=parts, looks=looks)


_WHITE_WORD = 0xFFFFFFFF


def _is_point(part: Part, faces: Bool) -> bool:
    """True where these faces (T,) lie on one point of the texture, as letters do."""
    assert part.uv is not None, "only a part with texture coordinates has a texture"
    uv = part.uv[part.faces[faces]].reshape(-1, 2)
    return bool((np.ptp(uv, axis=0) <= 1e-4).all())


def _seen(document: Document, rows: _Rows, face: int, part: Part, read: ReadTexture) -> Rgba:
    """The colour of a face of a part as a viewer shows it."""
    at = int(np.searchsorted(rows.face, face, side="right")) - 1
    primitive = rows.drawn[at].primitive
    material = primitive.material
    texture = None if material.texture is None else read(material.texture)
    points = Points(part.faces[face][None] - rows.row[at], np.full((1, 3), 1 / 3))
    return _fourfold(base_color(document, material, texture, primitive.attributes, points)[0])


def _fourfold(color: Float) -> Rgba:
    red, green, blue, alpha = (round(value, 6) for value in color.tolist())
    return red, green, blue, alpha


def _hex(color: Rgba) -> str:
    return hex_srgb(np.array(color[:3]))
