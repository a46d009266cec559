"""PLY, binary little endian: the vertices of a marked scene with normals, texture coordinates and colours."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.formats.corners import corners_of
from core.formats.drawing import Drawing
from core.formats.format import Format, Written
from core.formats.marked import Marked, coordinates, drawn, drawn_again
from core.formats.ply import COLOR_NAMES, FACE_LISTS, UV_NAMES, check_ply, read_ply
from core.formats.ply_header import Header

_KNOWN = {
    *("x", "y", "z", "nx", "ny", "nz", "texnumber", "texcoord", "alpha", "diffuse_alpha", *FACE_LISTS),
    *(name for names in (*UV_NAMES, *COLOR_NAMES) for name in names),
}
_TYPES = {"float": "<f4", "double": "<f8", "uchar": "u1"}


def write_ply(marked: Marked) -> Written:
    """All parts as one mesh. Where the input is a PLY, with its properties: doubles where it has them, texture
    coordinates of corners where it has those, the names of its textures, which lie beside it in the same archive.

    What the looks of a scene say is in the colours of vertices.
    """
    frame = coordinates(marked.format, Format.PLY)
    if marked.format.inner is Format.PLY:
        header = check_ply(marked.source, marked.budgets)
        before = read_ply(marked.source, header, marked.budgets).bodies[0]
        drawing = drawn_again(marked, before.positions, vertex_colors=True)
        style = replace(
            _style(header, any(material.texture for material in before.materials)), colored=marked.had_colors
        )
    else:
        drawing, style = drawn(marked, Format.PLY, vertex_colors=True)[0], _Style(colored=marked.had_colors)
    files = {"model.ply": b""}
    images = [f"texture-{number + 1}.{ending}" for number, (ending, _) in enumerate(drawing.images)]
    if style.textured:
        files |= {name: data for name, (_, data) in zip(images, drawing.images, strict=True)}
    files["model.ply"] = _ply(drawing, style, images, ["meshmark", *filter(str.isascii, marked.label_lines)])
    lost = {
        "textures": bool(drawing.images) and not style.textured,
        "names of materials": any(look.name for look in drawing.looks),
        "names and parts": len(drawing.parts) > 1,
        f"properties: {_listed(style.others)}": bool(style.others),
    }
    left_out = [*(what for what, there in lost.items() if there), *drawing.left_out]
    return Written(files, frame.unit, frame.up, left_out)


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(name[:40] for name in names[:8]) + (", ..." if len(names) > 8 else "")


@dataclass(frozen=True)
class _Style:
    """The manner in which a PLY is written.

    Attributes:
        kind: of positions, float or double.
        corners: texture coordinates are those of corners.
        uv: names of those of vertices.
        textured: its textures are beside it.
        colored: vertices have colours in any case.
        others: properties that no GLB has.
    """

    kind: str = "float"
    corners: bool = False
    uv: tuple[str, str] = ("s", "t")
    textured: bool = False
    colored: bool = False
    others: tuple[str, ...] = ()


def _style(header: Header, textured: bool) -> _Style:
    vertex, surface = header.element("vertex"), header.surface
    assert vertex is not None
    assert surface is not None, "the gate refuses a PLY without"
    kinds = {column.name: column.kind for column in vertex.properties}
    uv = next((names for names in UV_NAMES if set(names) <= kinds.keys()), None)
    columns = [column.name for element in (vertex, surface) for column in element.properties]
    others = tuple(name for name in columns if name not in _KNOWN)
    elements = tuple(element.name for element in header.elements if element not in (vertex, surface) and element.count)
    return _Style(
        kind="double" if kinds["x"] == "d" else "float",
        corners=uv is None and any(column.name == "texcoord" for column in surface.properties),
        uv=(uv[0], uv[1]) if uv else ("s", "t"),
        textured=textured,
        others=others + elements,
    )


def _ply(drawing: Drawing, style: _Style, images: list[str], comments: list[str]) -> bytes:
    positions = np.concatenate([part.positions for part in drawing.parts])
    corners = corners_of(drawing, keep_colors=style.colored)
    first, vertex = corners.vertices(mapped=not style.corners)
    points = corners.points.reshape(-1)
    columns: list[tuple[str, str, NDArray[Any]]] = list(
        zip("xyz", [style.kind] * 3, positions[points[first]].T, strict=True)
    )
    if corners.normals is not None:
        columns += zip(("nx", "ny", "nz"), ["float"] * 3, corners.normals[first].T, strict=True)
    if corners.uv is not None and not style.corners:
        columns += zip(style.uv, ["float"] * 2, corners.uv[first].T, strict=True)
    if corners.colors is not None:
        channels = ["red", "green", "blue", *(["alpha"] if (corners.colors[:, 3] < 255).any() else [])]
        columns += zip(channels, ["uchar"] * len(channels), corners.colors[first].T[: len(channels)], strict=True)
    table = np.zeros(len(first), [(name, _TYPES[kind]) for name, kind, _ in columns])
    for name, _, values in columns:
        table[name] = values

    fields: list[tuple[str, str, tuple[int, ...]]] = [("count", "u1", ()), ("corners", "<i4", (3,))]
    lists = ["property list uchar int vertex_indices"]
    if corners.uv is not None and style.corners:
        fields += [("values", "u1", ()), ("uv", "<f4", (6,))]
        lists.append("property list uchar float texcoord")
    if several := style.textured and len(images) > 1:
        fields.append(("texnumber", "<i4", ()))
        lists.append("property int texnumber")
    faces = np.zeros(len(vertex), fields)
    faces["count"], faces["corners"] = 3, vertex
    if corners.uv is not None and style.corners:
        faces["values"], faces["uv"] = 6, corners.uv.reshape(-1, 6)
    if several:
        faces["texnumber"] = corners.texture
    head = [
        *("ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)),
        *(f"comment TextureFile {name}" for name in (images if style.textured else [])),
        f"element vertex {len(table)}",
        *(f"property {kind} {name}" for name, kind, _ in columns),
        f"element face {len(faces)}",
        *lists,
        "end_header",
    ]
    return "\n".join(head).encode() + b"\n" + table.tobytes() + faces.tobytes()
