"""A model part of a 3MF as tables (3MF Core Specification 1.3; Materials and Properties Extension 1.2)."""

import re
from array import array
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from core.arrays import Float
from core.budgets import Budgets, within
from core.formats.xml import Handlers, Tally, parse_xml
from core.refusals import malformed

METRES = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
ROWS = ("vertex", "triangle")
GROUPS = ("basematerials", "colorgroup", "texture2dgroup", "compositematerials", "multiproperties")

# Most files hold nothing but millions of these; taken out in one go they cost a third of what a parser's calls do.
_PLAIN_ROWS = re.compile(
    rb'<(vertices)>((?:\s*+<vertex\s++x="[^"<&]*+"\s++y="[^"<&]*+"\s++z="[^"<&]*+"\s*+/>)++)\s*+</vertices>'
    rb'|<(triangles)>((?:\s*+<triangle\s++v1="[^"<&]*+"\s++v2="[^"<&]*+"\s++v3="[^"<&]*+"\s*+/>)++)\s*+</triangles>'
)
_PIECE = 2**18  # bytes
IDENTITY = np.eye(4)  # one and the same object for all that have no transform, so that it is known
IDENTITY.flags.writeable = False
_PATH = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06 path"


@dataclass(frozen=True, eq=False)
class Use:
    """A component or a build item: its object, the part of that (``None``: this one), and its (4, 4) matrix."""

    part: str | None
    object_id: str
    matrix: Float


@dataclass(eq=False)
class Object:
    """A mesh or a list of components.

    Attributes:
        name: as in the file, else by its id.
        kind: "model", "surface", or one of :data:`core.formats.threemf_slicer.OBJECT_TYPES`.
        group, row: the property of triangles that name none; an empty group where there is none.
        vertices: x, y, z of each.
        triangles: three vertex numbers of each.
        properties: for each triangle with a property its number, the number of the group, and a row for each corner.
        groups: the ids of the groups, by their number.
        components: that it consists of.
    """

    name: str
    kind: str
    group: str
    row: int
    vertices: "array[float]" = field(default_factory=lambda: array("d"))
    triangles: "array[int]" = field(default_factory=lambda: array("q"))
    properties: "array[int]" = field(default_factory=lambda: array("q"))
    groups: dict[str, int] = field(default_factory=dict)
    components: list[Use] = field(default_factory=list)


@dataclass(eq=False)
class Group:
    """A table of ``kind``: its rows are attributes of the elements in it; ``texture`` is the id of its texture."""

    kind: str
    texture: str
    rows: list[dict[str, str]] = field(default_factory=list)


class Model:
    """A model part.

    Args:
        data: the XML.
        what: the part in errors.
        budgets: bounds vertices, triangles, objects, uses and all other elements of the part.
        tally: of the XML parts of the package.

    Attributes:
        metres: the length of its unit.
        objects, groups, textures: by id; of a texture its path in the package.
        items: of the build.

    Raises:
        MeshmarkError: ``malformed_file``, ``budget_exceeded``, ``unsupported_feature``.
    """

    def __init__(self, data: bytes, what: str, budgets: Budgets, tally: Tally) -> None:
        self.metres = METRES["millimeter"]
        self.objects: dict[str, Object] = {}
        self.groups: dict[str, Group] = {}
        self.textures: dict[str, str] = {}
        self.items: list[Use] = []
        self._what, self._budgets = what, budgets
        self._vertices = self._triangles = self._uses = 0
        self._object = Object("", "", "", 0)  # the one being read; elements outside of any are discarded
        self._group = Group("", "")
        data, self._plain = _without_plain_rows(data)
        handlers: dict[str, Callable[[dict[str, str]], None]] = {
            "plain_vertices": self._plain_vertices,
            "plain_triangles": self._plain_triangles,
            "vertex": self._vertex,
            "triangle": self._triangle,
            "object": self._start_object,
            "component": self._component,
            "item": self._item,
            "model": self._unit,
            "texture2d": self._texture,
            "color": self._row,
            "base": self._row,
            "tex2coord": self._row,
            **{kind: partial(self._start_group, kind) for kind in GROUPS},
        }

        def start(name: str, attributes: dict[str, str]) -> None:
            if (handle := handlers.get(name)) is not None:
                handle(attributes)

        try:
            parse_xml(data, what, budgets, Handlers(start), tally=tally, rows=ROWS)
        except KeyError as error:
            raise malformed(f"An element of {what} lacks its attribute {error}.") from None
        except (ValueError, OverflowError) as error:
            raise malformed(f"{what} has a number that is none: {str(error)[:80]}.") from None

    def _vertex(self, attributes: dict[str, str]) -> None:
        self._object.vertices.extend((float(attributes["x"]), float(attributes["y"]), float(attributes["z"])))
        self._vertices += 1
        if self._vertices > self._budgets.vertices:
            within(self._vertices, self._budgets.vertices, "vertices")

    def _plain_vertices(self, _: dict[str, str]) -> None:
        rows = self._plain.popleft()
        self._vertices += rows.count(b"/>")
        within(self._vertices, self._budgets.vertices, "vertices")
        for words in _numbers(rows):
            self._object.vertices.extend(map(float, words))

    def _plain_triangles(self, _: dict[str, str]) -> None:
        rows, thing = self._plain.popleft(), self._object
        first, count = len(thing.triangles) // 3, rows.count(b"/>")
        self._triangles += count
        within(self._triangles, self._budgets.faces, "triangles")
        for words in _numbers(rows):
            thing.triangles.extend(map(int, words))
        if thing.group:
            properties = np.empty((count, 5), np.int64)
            properties[:, 0] = np.arange(first, first + count)
            properties[:, 1:] = thing.groups.setdefault(thing.group, len(thing.groups)), *[thing.row] * 3
            thing.properties.frombytes(properties.tobytes())

    def _triangle(self, attributes: dict[str, str]) -> None:
        thing = self._object
        if thing.group or "pid" in attributes:  # slicers add attributes of their own
            pid = attributes.get("pid", thing.group)
            first = int(attributes.get("p1", thing.row))
            second, third = int(attributes.get("p2", first)), int(attributes.get("p3", first))
            group = thing.groups.setdefault(pid, len(thing.groups))
            thing.properties.extend((len(thing.triangles) // 3, group, first, second, third))
        thing.triangles.extend((int(attributes["v1"]), int(attributes["v2"]), int(attributes["v3"])))
        self._triangles += 1
        if self._triangles > self._budgets.faces:
            within(self._triangles, self._budgets.faces, "triangles")

    def _start_object(self, attributes: dict[str, str]) -> None:
        number = attributes["id"]
        name = attributes.get("name") or f"object {number[:20]}"
        kind = attributes.get("type", "model")
        self._object = Object(name, kind, attributes.get("pid", ""), int(attributes.get("pindex", 0)))
        if number in self.objects:
            raise malformed(f"{self._what} has two objects of the id {number[:20]!r}.")
        self.objects[number] = self._object
        within(len(self.objects), self._budgets.nodes, "objects")

    def _component(self, attributes: dict[str, str]) -> None:
        self._object.components.append(self._use(attributes))

    def _item(self, attributes: dict[str, str]) -> None:
        self.items.append(self._use(attributes))

    def _use(self, attributes: dict[str, str]) -> Use:
        self._uses += 1
        within(self._uses, self._budgets.nodes, "components and build items")
        return Use(attributes.get(_PATH), attributes["objectid"], _matrix(attributes.get("transform", "")))

    def _unit(self, attributes: dict[str, str]) -> None:
        unit = attributes.get("unit", "millimeter")
        if unit not in METRES:
            raise malformed(f"{self._what} is in {unit[:20]!r}, which is no unit of a 3MF.")
        self.metres = METRES[unit]

    def _start_group(self, kind: str, attributes: dict[str, str]) -> None:
        self._group = self.groups[attributes["id"]] = Group(kind, attributes.get("texid", ""))

    def _row(self, attributes: dict[str, str]) -> None:
        self._group.rows.append(attributes)

    def _texture(self, attributes: dict[str, str]) -> None:
        self.textures[attributes["id"]] = attributes["path"]


def _without_plain_rows(data: bytes) -> tuple[bytes, deque[bytes]]:
    """The XML with an empty element for each table of plain vertices or triangles, and these rows in this order.

    Files in which such a table may be something else, such as a part of a comment, stay as they are.
    """
    tables: deque[bytes] = deque()
    if b"<!" in data or b"<plain_" in data or data.count(b"<?") > 1:
        return data, tables

    def take(found: re.Match[bytes]) -> bytes:
        kind, rows = (found[1], found[2]) if found[1] else (found[3], found[4])
        tables.append(rows)
        return b"<plain_%b/>" % kind + b"\n" * found[0].count(b"\n")  # errors tell lines

    return _PLAIN_ROWS.sub(take, data), tables


def _numbers(rows: bytes) -> Iterator[list[bytes]]:
    """The values of all attributes, some thousand rows at a time."""
    at = 0
    while at < len(rows):
        end = rows.find(b"/>", at + _PIECE)
        end = len(rows) if end < 0 else end + 2
        yield rows[at:end].split(b'"')[1::2]
        at = end


def _matrix(text: str) -> Float:
    """(4, 4) for column vectors from the twelve numbers of a 3MF, which are for row vectors; or :data:`IDENTITY`."""
    matrix = IDENTITY
    if text:
        numbers = np.array([float(word) for word in text.split()])
        if len(numbers) != 12 or not np.abs(numbers).max() <= 1e12:
            raise ValueError(f"transform {text[:40]!r}")
        matrix = np.vstack([numbers.reshape(4, 3).T, [0, 0, 0, 1]])
    return matrix
