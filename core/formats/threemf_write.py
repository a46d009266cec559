"""3MF: parts, instances, colours and metadata as they came; the core specification and that of materials."""

import re
from dataclasses import replace
from xml.sax.saxutils import escape as _escaped

import numpy as np

from core.arrays import Float
from core.formats.archive import Archive
from core.formats.assemble import is_transform, moved, origin_of
from core.formats.assembly import Assembly
from core.formats.draw import draw
from core.formats.drawing import Part
from core.formats.format import Format, Written
from core.formats.marked import Marked, coordinates
from core.formats.threemf import Key, Package, read_3mf
from core.formats.threemf_model import METRES, Use
from core.formats.threemf_resources import Resources, attribute
from core.formats.threemf_slicer import OBJECT_TYPES, SETTINGS, Tools, read_tools
from core.formats.vertices import restored, shortest
from core.formats.zip_write import zip_of
from core.geometry.products import product, solved

Placed = tuple[int, Float]  # the id of an object, and the (4, 4) matrix of one of its uses

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_MATERIAL = "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"
_RELATIONS = "http://schemas.openxmlformats.org/package/2006"
_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01"
_MODEL = "3D/3dmodel.model"

# Names without a prefix, which are those of the specification: others are for the programs that wrote them.
_METADATA = re.compile(rb"<(?:\w+:)?metadata\s[^<>]*?name\s*=\s*[\"']([^\"':<&]{1,255})[\"'][^<>]*>([^<]{0,65536})</")
_RESOURCES = re.compile(rb"<(?:\w+:)?resources\b")


def write_3mf(marked: Marked) -> Written:
    """One object for each mesh and an item for each of its uses; those of the input where that is a 3MF, with its unit.

    The settings of slicers, which count triangles, and pictures of the input are left out.
    """
    if marked.format.inner is not Format.THREEMF:
        return _converted(marked)
    drawing = draw(marked.scene, vertex_colors=marked.had_colors)
    archive = Archive(marked.source.data, marked.budgets)
    assembly, package = read_3mf(marked.source, archive, marked.budgets), Package(archive, marked.budgets)
    start = package.start_part()
    unit = next(name for name, metres in METRES.items() if metres == package.model(start).metres)
    resources = Resources(drawing)
    numbers = _meshes(assembly, drawing.parts, resources)
    tools = read_tools(archive, marked.budgets, package.tally, [])
    items = _Structure(package, start, tools, numbers, resources).items()
    head = archive.read(start)[: _head(archive.read(start))]
    metadata = [(name.decode(), text.decode("utf-8", "replace")) for name, text in _METADATA.findall(head)]
    lost = {
        "settings of slicers": any(map(SETTINGS.fullmatch, archive.names)),
        "parts without a volume": 0 in numbers,
        "thumbnails": any("thumbnail" in name.lower() for name in archive.names),
    }
    left_out = [*(what for what, there in lost.items() if there), *drawing.left_out]
    return Written({"model.3mf": _package(resources, items, unit, metadata, marked)}, unit, "z", left_out)


def _head(data: bytes) -> int:
    """Bytes of a model before its resources."""
    found = _RESOURCES.search(data)
    return len(data) if found is None else found.start()


def _converted(marked: Marked) -> Written:
    """A result that came in another format."""
    frame, drawing = coordinates(marked.format, Format.THREEMF), draw(marked.scene)
    scale = float(np.linalg.norm(frame.matrix[:3, 0]))
    turn = np.eye(4)
    turn[:3, :3] = frame.matrix[:3, :3] / scale
    resources = Resources(drawing)
    numbers: dict[int, int] = {}
    items: list[Placed] = []
    for part in drawing.parts:
        upright = product(turn, product(part.matrix, turn.T))
        upright[:3, 3] *= scale
        if np.linalg.det(part.matrix[:3, :3]) <= 0 or not is_transform(part.matrix):
            whole = part.moved(product(frame.matrix, part.matrix))
            items.append((resources.mesh(part.name, whole), np.eye(4)))
            continue
        if part.mesh not in numbers:
            own = part if scale != 1 else replace(part, positions=shortest(part.positions))
            numbers[part.mesh] = resources.mesh(part.name, own.moved(frame.matrix))
        items.append((numbers[part.mesh], upright))
    left_out = list(drawing.left_out)
    if any(ending == "webp" for ending, _ in drawing.images):
        left_out.append("WebP textures")
    if any(look.normal_map is not None for look in drawing.looks):
        left_out.append("normal maps")
    build = b"".join(_use("item", number, matrix) for number, matrix in items if number)
    data = _package(resources, build, "millimeter", [], marked)
    return Written({"model.3mf": data}, "millimeter" if frame.unit else None, frame.up, left_out)


def _meshes(assembly: Assembly, parts: list[Part], resources: Resources) -> list[int]:
    """The id of the object of each instance, written with the very coordinates of its body; 0 where it is empty."""
    by_node: dict[int, Part] = {part.node: part for part in parts}
    written: dict[tuple[int, int, bytes], int] = {}
    numbers, node = [], 0
    for instance in assembly.instances:
        body = assembly.bodies[instance.body]
        if not len(body.sizes):
            numbers.append(0)
            continue
        part = by_node[node]
        node += 1
        shear = b"" if is_transform(instance.matrix) else instance.matrix.tobytes()
        key = instance.body, part.mesh, shear
        if key not in written:
            stored = moved(body, instance.matrix) if shear else body
            positions = restored(part.positions, stored.positions, origin_of(stored.positions[stored.corners]))
            own = replace(part, matrix=np.eye(4), positions=positions)
            back = _inverse(instance.matrix) if shear else np.eye(4)
            # A part that its matrix flattens cannot be led back, and is nothing to print.
            whole = np.isfinite(back).all()
            written[key] = resources.mesh(assembly.names[instance.body], own.moved(back)) if whole else 0
        numbers.append(written[key])
    return numbers


def _inverse(matrix: Float) -> Float:
    """The inverse (4, 4) of a matrix, with the same bits on every processor; not finite where there is none."""
    result = np.eye(4)
    result[:3, :3] = np.stack([solved(matrix[:3, :3], axis) for axis in np.eye(3)], axis=1)
    with np.errstate(invalid="ignore"):
        result[:3, 3] = -product(result[:3, :3], matrix[:3, 3:])[:, 0]
    return result


class _Structure:
    """The build of a 3MF, written anew with other meshes: an object is divided where its uses have different ones."""

    def __init__(self, package: Package, start: str, tools: Tools, numbers: list[int], resources: Resources) -> None:
        self._package, self._start, self._tools, self._resources = package, start, tools, resources
        self._numbers = iter(numbers)  # of the meshes, in the order in which the reader meets them
        self._written: dict[tuple[Key, bytes], int] = {}

    def items(self) -> bytes:
        """The elements of the build."""
        uses = self._package.model(self._start).items
        return b"".join(self._use("item", use, self._start) for use in uses)

    def _use(self, element: str, use: Use, beside: str) -> bytes:
        number = self._object(self._package.key(use.part, use.object_id, beside))
        return _use(element, number, use.matrix) if number else b""

    def _object(self, key: Key) -> int:
        """The id of an object; 0 where nothing of it is built."""
        thing = self._package.find(key)
        if thing.kind in OBJECT_TYPES:
            return 0
        mesh = next(self._numbers) if len(thing.triangles) else 0
        components = [
            self._use("component", part, key[0])
            for part in thing.components
            if key[0] != self._start or (key[1], part.object_id) not in self._tools.parts
        ]
        components = [component for component in components if component]
        if not components:
            return mesh
        if mesh:
            components.insert(0, _use("component", mesh, np.eye(4)))
        variant = key, b"".join(components)
        if variant not in self._written:
            self._written[variant] = self._resources.composite(thing.name, components)
        return self._written[variant]


def _use(element: str, number: int, matrix: Float) -> bytes:
    """A component or build item; a 3MF has matrices for row vectors."""
    transform = ""
    if not np.array_equal(matrix, np.eye(4)):
        words = " ".join(_number(value) for value in matrix[:3].T.ravel().tolist())
        transform = f' transform="{words}"'
    return f'<{element} objectid="{number}"{transform}/>\n'.encode()


def _number(value: float) -> str:
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(value)


def _package(resources: Resources, build: bytes, unit: str, metadata: list[tuple[str, str]], marked: Marked) -> bytes:
    """The ZIP of a 3MF."""
    known = dict(metadata)
    rows = [
        f"<metadata name={attribute(name)}>{text}</metadata>\n"  # as it is escaped in the input
        for name, text in {"Application": "meshmark", **known}.items()
    ]
    spaces, own = "", []
    for number, (name, value) in enumerate(marked.label.items()):
        space, _, last = name.rpartition("/")
        spaces += f" xmlns:l{number}={attribute(space + '/')}"
        own.append(f'<metadata name="l{number}:{last}">{_escaped(value)}</metadata>\n')
    model = b"".join(
        [
            b'<?xml version="1.0" encoding="UTF-8"?>\n',
            f'<model unit="{unit}" xml:lang="en-US" xmlns="{_CORE}" xmlns:m="{_MATERIAL}"{spaces}>\n'.encode(),
            "".join(rows + own).encode(),
            resources.xml(),
            b"<build>\n" + build + b"</build>\n</model>\n",
        ]
    )
    types = {"rels": "application/vnd.openxmlformats-package.relationships+xml"}
    types |= {"model": "application/vnd.ms-package.3dmanufacturing-3dmodel+xml"}
    types |= {"png": "image/png", "jpg": "image/jpeg"} if resources.pictures else {}
    defaults = "".join(f'<Default Extension="{ending}" ContentType="{kind}"/>' for ending, kind in types.items())
    files = {
        "[Content_Types].xml": _xml(f'<Types xmlns="{_RELATIONS}/content-types">{defaults}</Types>'),
        "_rels/.rels": _relations({f"/{_MODEL}": f"{_TYPE}/3dmodel"}),
        _MODEL: model,
    }
    if resources.pictures:
        files["3D/_rels/3dmodel.model.rels"] = _relations(
            {f"/{path}": f"{_TYPE}/3dtexture" for path in resources.pictures}
        )
    return zip_of(files | resources.pictures)


def _xml(text: str) -> bytes:
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _relations(targets: dict[str, str]) -> bytes:
    rows = "".join(
        f'<Relationship Target="{target}" Id="rel{number}" Type="{kind}"/>'
        for number, (target, kind) in enumerate(targets.items())
    )
    return _xml(f'<Relationships xmlns="{_RELATIONS}/relationships">{rows}</Relationships>')
