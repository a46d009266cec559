"""OBJ with its MTL and textures: groups, objects, materials and names as they came."""

import posixpath
from dataclasses import dataclass, field

import numpy as np

from core.arrays import Int
from core.formats.archive import Archive
from core.formats.draw import draw
from core.formats.drawing import Drawing, Look, Part, bytes_of
from core.formats.format import Format, Written
from core.formats.marked import Marked, coordinates, drawn, drawn_again
from core.formats.mtl import read_mtl
from core.formats.names import texts
from core.formats.obj_state import States, read_states, states_of_faces
from core.formats.obj_zip import libraries_of, read_obj
from core.formats.text import Lines, joined_lines
from core.formats.text_write import lines
from core.formats.textures import IMAGE_ENDINGS
from core.formats.vertices import joined
from core.gltf.colors import srgb

_PICTURES = (*IMAGE_ENDINGS, ".tga", ".bmp", ".tif", ".tiff", ".gif", ".dds", ".exr", ".hdr")


def write_obj(marked: Marked) -> Written:
    """The OBJ, the MTL files and textures of its input beside it as they came, and an MTL of what is new."""
    frame = coordinates(marked.format, Format.OBJ)
    if marked.format.inner is not Format.OBJ:
        drawing = drawn(marked, Format.OBJ)[0]
        nodes = np.repeat(np.arange(len(drawing.parts)), [len(part.faces) for part in drawing.parts])
        states = States([(b"o " + _word(part.name),) for part in drawing.parts], nodes)
        files = _files(drawing, states, marked.label_lines, "model", _Beside())
        return Written(files, frame.unit, frame.up, drawing.left_out)
    source = marked.source
    body = read_obj(source, None, marked.budgets).bodies[0]
    drawing = drawn_again(marked, body.positions, vertex_colors=marked.had_colors)
    states = read_states(Lines(joined_lines(source.data)))
    if len(states.texts) > 1:
        raw = draw(marked.scene, vertex_colors=marked.had_colors)
        faces = states_of_faces(states, body, raw, marked.before, marked.edit)
    else:
        faces = np.zeros(sum(len(part.faces) for part in drawing.parts), np.int64)
    beside = _beside(source.archive, source.name, source.data) if source.archive else _Beside()
    stem = posixpath.splitext(source.name or "model.obj")[0]
    files = _files(drawing, States(states.texts, faces), marked.label_lines, stem, beside)
    return Written(files, frame.unit, frame.up, drawing.left_out)


@dataclass(frozen=True, eq=False)
class _Beside:
    """MTL files and their pictures by name, and the names of the materials in them, as bytes, by their text."""

    files: dict[str, bytes] = field(default_factory=dict)
    materials: dict[str, bytes] = field(default_factory=dict)


def _beside(archive: Archive, name: str, data: bytes) -> _Beside:
    """The MTL files of the input, and the pictures that they name."""
    libraries = libraries_of(archive, name, data, [])
    files = {entry: archive.read(entry) for entry in libraries}
    named = b"\n".join(files.values()).lower()
    materials: dict[str, bytes] = {}
    for library in libraries:
        known = list(read_mtl(files[library], lambda _path: None)[0])
        materials = {text: raw for raw, text in texts(known).items()} | materials
    for entry in archive.names:
        last = posixpath.basename(entry).lower()
        # The MTL may write a name in any code page; other pictures show the model without its marks.
        if last.endswith(_PICTURES) and (not last.isascii() or last.encode() in named):
            files[entry] = archive.read(entry)
    return _Beside(files, materials)


def _files(drawing: Drawing, states: States, comments: list[str], stem: str, beside: _Beside) -> dict[str, bytes]:
    """The files of an OBJ by name.

    Args:
        drawing: in its coordinates.
        states: lines that hold for faces, in the order of the drawing.
        comments: at its beginning.
        stem: of its name.
        beside: files of the input, which stay.
    """
    used = np.unique(np.concatenate([part.look for part in drawing.parts]))
    names, own = _names(drawing, used, beside.materials)
    images: dict[int, str] = {}
    files = dict(beside.files)
    known = {data: name for name, data in beside.files.items()}
    folder = posixpath.dirname(stem)
    for look in own.values():
        for number in (look.image, look.normal_map):
            if number is not None and number not in images:
                ending, data = drawing.images[number]
                name = known.get(data) or _free(posixpath.join(folder, f"texture-{number + 1}"), f".{ending}", files)
                files[name] = data
                images[number] = posixpath.relpath(name, folder or ".")
    libraries = [name for name in files if name.lower().endswith(".mtl")]
    if own:
        libraries.append(_free(f"{stem}-letters" if libraries else stem, ".mtl", files))
        files[libraries[-1]] = b"".join(_mtl(name, look, images) for name, look in own.items())
    head = [f"# {line}" for line in ("meshmark", *comments)]
    head += [f"mtllib {posixpath.relpath(name, folder or '.')}" for name in libraries]
    text = "".join(f"{line}\n" for line in head).encode() + _obj(drawing, states, names)
    return {f"{stem}.obj": text} | files


def _free(stem: str, ending: str, taken: dict[str, bytes]) -> str:
    """A name that no file has."""
    number, name = 1, stem + ending
    while name in taken:
        number += 1
        name = f"{stem}-{number}{ending}"
    return name


def _names(drawing: Drawing, used: Int, materials: dict[str, bytes]) -> tuple[dict[int, bytes], dict[bytes, Look]]:
    """The name of each look that is used, empty where it is plain; and the looks that need to be described."""
    colored = any(part.colors is not None for part in drawing.parts)
    names: dict[int, bytes] = {}
    own: dict[bytes, Look] = {}
    for number in used.tolist():
        look = drawing.looks[number]
        if look.name in materials:
            names[number] = materials[look.name]
        elif look.is_neutral or (colored and look.is_white):
            names[number] = b""
        else:
            word = name = _word(look.name or f"material-{number + 1}")
            count = 1
            while name in own or name in materials.values():
                count += 1
                name = word + f"-{count}".encode()
            names[number], own[name] = name, look
    return names, own


def _word(name: str) -> bytes:
    """A name on one line."""
    return (" ".join(name.split()) or "model").encode(errors="replace")


def _obj(drawing: Drawing, states: States, names: dict[int, bytes]) -> bytes:
    blocks, faces, layouts = [], [], []
    counts = np.zeros(3, np.int64)  # of vertices, texture coordinates and normals so far
    colored = any(part.colors is not None for part in drawing.parts)
    for part in drawing.parts:
        vertex, first = _vertices(part)
        columns = [part.positions[first]]
        if colored:
            colors = np.ones((len(part.positions), 4)) if part.colors is None else part.colors
            columns.append(bytes_of(colors)[first, :3] / 255)
        blocks.append(lines("v %r %r %r" + " %.6g %.6g %.6g" * colored, np.hstack(columns)))
        corner = np.zeros((len(part.faces), 3, 3), np.int64)
        corner[..., 0] = vertex[part.faces] + counts[0] + 1
        sizes = [len(first), 0, 0]
        for column, values, pattern in ((1, _flipped(part), "vt %.9g %.9g"), (2, part.normals, "vn %.7g %.7g %.7g")):
            if values is not None:
                rows = np.flatnonzero(np.isfinite(values).all(axis=1))
                unique, number = np.unique(values[rows], axis=0, return_inverse=True)
                index = np.zeros(len(values), np.int64)
                index[rows] = number.reshape(-1) + counts[column] + 1
                corner[..., column] = index[part.faces]
                sizes[column] = len(unique)
                blocks.append(lines(pattern, unique))
        counts += sizes
        present = np.all(corner > 0, axis=1)
        layouts.append(present[:, 1] + 2 * present[:, 2])
        faces.append(corner)
    return b"".join(blocks) + _faces(np.concatenate(faces), np.concatenate(layouts), drawing, states, names)


def _vertices(part: Part) -> tuple[Int, Int]:
    """The vertices of an OBJ: rows of one point and colour."""
    if part.colors is None:
        return joined(part.positions, part.faces)
    words = bytes_of(part.colors).view("<u4").astype(np.float64)
    return joined(np.column_stack([part.positions, words]), part.faces)


def _flipped(part: Part) -> np.ndarray[tuple[int, int], np.dtype[np.float64]] | None:
    return None if part.uv is None else np.column_stack([part.uv[:, 0], 1 - part.uv[:, 1]])


_PATTERNS = {0: "f %d %d %d", 1: "f %d/%d %d/%d %d/%d", 2: "f %d//%d %d//%d %d//%d", 3: "f" + " %d/%d/%d" * 3}
_COLUMNS = {0: [0], 1: [0, 1], 2: [0, 2], 3: [0, 1, 2]}


def _faces(corner: Int, layout: Int, drawing: Drawing, states: States, names: dict[int, bytes]) -> bytes:
    """The faces (T, 3, 3) by state and material: those without one come first, since no line ends one."""
    state = states.of_face
    look = np.concatenate([part.look for part in drawing.parts])
    named = np.zeros(len(drawing.looks), np.int64)
    named[[number for number, name in names.items() if name]] = 1
    key = ((named[look] * len(states.texts) + state) * len(drawing.looks) + look) * 4 + layout
    order = np.argsort(key, kind="stable")
    runs = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
    blocks, before = [], (b"", b"")
    for rows in runs:
        first = rows[0]
        now = (b"\n".join(filter(None, states.texts[state[first]])), names[int(look[first])])
        if now[0] != before[0]:
            blocks.append(now[0] + b"\n" if now[0] else b"g\n")
        if now[1] != before[1]:
            blocks.append(b"usemtl " + now[1] + b"\n")
        kind = int(layout[first])
        blocks.append(lines(_PATTERNS[kind], corner[rows][:, :, _COLUMNS[kind]].reshape(len(rows), -1)))
        before = now
    return b"".join(blocks)


def _mtl(name: bytes, look: Look, images: dict[int, str]) -> bytes:
    color = " ".join(f"{value:.6g}" for value in srgb(np.array(look.color[:3])))
    rows = [f"Kd {color}", f"d {look.color[3]:.6g}", f"Pm {look.metallic:.6g}", f"Pr {look.roughness:.6g}", "illum 2"]
    if any(look.emissive):
        rows.append("Ke " + " ".join(f"{value:.6g}" for value in srgb(np.array(look.emissive))))
    if look.image is not None:
        rows += [f"{use} {images[look.image]}" for use in ("map_Kd", *(["map_d"] if look.masked else []))]
    if look.normal_map is not None:
        rows.append(f"norm {images[look.normal_map]}")
    return b"newmtl " + name + b"\n" + "".join(f"{row}\n" for row in rows).encode() + b"\n"
