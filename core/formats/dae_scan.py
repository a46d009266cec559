"""Geometries that a DAE draws, their instances and sizes: counted before it is loaded."""

from dataclasses import dataclass, field

from core.budgets import Budgets, within
from core.errors import ErrorCode, MeshmarkError
from core.formats.xml import Handlers, parse_xml
from core.refusals import malformed, non_finite

READ = ("triangles", "polylist", "polygons")
_LOST = {
    "animation": "animations",
    "instance_camera": "cameras",
    "instance_light": "lights",
}
_NOT_READ = ("tristrips", "trifans")
CONTROLLER_DEPTH = 8  # controllers in a chain, at most; a skin over a morph has two
_USES = ("instance_node", "instance_geometry", "instance_controller")


@dataclass(eq=False, slots=True)
class _Node:
    children: list["_Node"] = field(default_factory=list)
    uses: list[tuple[str, str]] = field(default_factory=list)  # an element of _USES, and the id in it


@dataclass(eq=False, slots=True)
class _Geometry:
    name: str = ""
    sets: int = 0  # of polygons that are read
    triangles: int = 0  # at most


class Scan:
    """The facts of a DAE that its loader does not give.

    Args:
        data: the XML.
        budgets: bounds triangles and nodes, instances of instances included.

    Attributes:
        metres: length of its unit.
        up_axis: ``X_UP``, ``Y_UP`` or ``Z_UP``.
        names: of the geometries, by id.
        drawn: number of sets of polygons that the scene draws.
        has_controllers: it draws skins or morphs.
        not_read: names of elements that are not read.

    Raises:
        MeshmarkError: ``malformed_file``, ``budget_exceeded``, ``unsupported_feature``.
    """

    def __init__(self, data: bytes, budgets: Budgets) -> None:
        self.metres = 1.0
        self.up_axis = "Y_UP"
        self.has_controllers = False
        self.not_read: set[str] = set()
        self._geometries: dict[str, _Geometry] = {}
        self._controlled: dict[str, str] = {}  # by each controller: a geometry, or another controller
        self._controller = ""  # the one being read
        self._nodes: dict[str, _Node] = {}
        self._path: list[str] = []  # of the element being read
        self._open = [_Node()]  # the nodes around it; the first is the scene
        self._geometry = _Geometry()
        self._stride = 1
        self._indices = 0  # since the last <p> ended
        self._text = ""  # of the up axis, or the last of the piece before this one
        parse_xml(data, "The DAE", budgets, Handlers(self._start, self._end, self._read_text))
        try:
            self.drawn, triangles = self._count(self._open[0], {})
        except RecursionError:
            raise malformed("The nodes of the DAE refer to each other too deeply.") from None
        within(self.drawn, budgets.nodes, "things to draw, instances of instances included")
        within(triangles, budgets.faces, "triangles")

    @property
    def names(self) -> dict[str, str]:
        """The names of the geometries by id."""
        return {key: geometry.name or key for key, geometry in self._geometries.items()}

    @property
    def why_nothing_is_drawn(self) -> str:
        """A sentence for a scene without polygons that are read."""
        also = f" It has {', '.join(sorted(self.not_read))}, which are not read." if self.not_read else ""
        return f"The scene of the DAE draws none of its {len(self._geometries):,} geometries.{also}"

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._path.append(name)
        if name == "node":
            node = self._nodes[attributes.get("id", "")] = _Node()
            if "library_nodes" not in self._path or len(self._open) > 1:
                self._open[-1].children.append(node)
            self._open.append(node)
        elif name in _USES:
            self.has_controllers |= name == "instance_controller"
            self._open[-1].uses.append((name, attributes.get("url", "").removeprefix("#")))
        elif name == "controller":
            self._controller = attributes.get("id", "")
        elif name in ("skin", "morph"):
            self._controlled[self._controller] = attributes.get("source", "").removeprefix("#")
        elif name in _LOST:
            self.not_read.add(_LOST[name])
        elif name == "geometry":
            key = attributes.get("id", "")
            self._geometry = self._geometries[key] = _Geometry(attributes.get("name", ""))
        elif name in READ:
            self._stride = 1
            self._geometry.sets += 1
        elif name in _NOT_READ:
            self.not_read.add(name)
        elif name == "input" and attributes.get("offset", "").isdecimal():
            self._stride = max(self._stride, int(attributes["offset"][:6]) + 1)
        elif name == "unit" and self._path[:2] == ["COLLADA", "asset"]:
            self.metres = _positive(attributes.get("meter", "1"))

    def _end(self, name: str) -> None:
        self._path.pop()
        if name == "node":
            self._open.pop()
        elif name == "up_axis" and self._path == ["COLLADA", "asset"]:
            self.up_axis = self._text.strip()
            if self.up_axis not in ("X_UP", "Y_UP", "Z_UP"):
                raise malformed(f"The up axis of the DAE is {self.up_axis[:20]!r}.")
        elif name == "p":
            corners = self._indices // self._stride
            self._geometry.triangles += corners // 3 if "triangles" in self._path else corners
            self._indices = 0
        self._text = ""

    def _read_text(self, text: str) -> None:
        element = self._path[-1]
        if element == "float_array" and "geometry" in self._path:
            if "nan" in (self._text + text).lower():
                raise non_finite("A geometry of the DAE has values that are not numbers.")  # its loader would take 0
            self._text = text[-2:]
        elif element == "up_axis":
            self._text += text[:20]
        elif element == "p":
            self._indices += len(text.split())  # one that is split between two pieces counts twice

    def _count(self, node: _Node, known: dict[int, tuple[int, int] | None]) -> tuple[int, int]:
        """Numbers of sets of polygons and of triangles that a node draws."""
        if id(node) in known:
            if (counted := known[id(node)]) is None:
                raise malformed("The nodes of the DAE refer to each other in a circle.")
            return counted
        known[id(node)] = None
        counts = [self._count(child, known) for child in node.children]
        for kind, key in node.uses:
            if kind == "instance_node" and key in self._nodes:
                counts.append(self._count(self._nodes[key], known))
                continue
            if kind == "instance_controller":
                key = self._controlled_by(key)
            if kind != "instance_node" and key in self._geometries:
                counts.append((self._geometries[key].sets, self._geometries[key].triangles))
        known[id(node)] = total = sum(count[0] for count in counts), sum(count[1] for count in counts)
        return total

    def _controlled_by(self, key: str) -> str:
        """The geometry that a controller moves, through others where it moves these."""
        for _ in range(CONTROLLER_DEPTH):
            if key not in self._controlled:
                return key
            key = self._controlled[key]
        raise malformed(f"The controllers of the DAE control each other more than {CONTROLLER_DEPTH} deep.")


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 1e-12 < value < 1e12:
        raise MeshmarkError(
            ErrorCode.MALFORMED_FILE, f"The unit of the DAE is {text[:20]!r} metres.", "Export it in metres."
        )
    return value
