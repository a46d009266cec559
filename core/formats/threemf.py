"""3MF: its build items, with components, units and colours."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np

from core.arrays import Float, Int
from core.budgets import Budgets, within
from core.formats.archive import Archive
from core.formats.assembly import Assembly, Instance, dropped
from core.formats.polygons import Attribute, Material, PolygonMesh
from core.formats.source import Source
from core.formats.textures import check_pixels, usable_image
from core.formats.threemf_model import IDENTITY, Group, Model, Object
from core.formats.threemf_slicer import OBJECT_TYPES, Tools, read_tools
from core.formats.xml import Handlers, Tally, check_xml, count_elements, parse_xml
from core.geometry.products import product
from core.gltf.colors import linear
from core.notices import Notice
from core.refusals import malformed, no_faces

Key = tuple[str, str]  # a model part and the id of an object in it

USUAL_PART = "3D/3dmodel.model"
_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_NO_COLOR = {"compositematerials": "composite materials", "multiproperties": "layered properties"}


def check_3mf(source: Source, budgets: Budgets) -> Archive:
    """Refuse a 3MF whose models are beyond the budgets.

    Parts may write their elements with a prefix: then only the loader counts them.

    Returns:
        Its archive.

    Raises:
        MeshmarkError: ``malformed_file``, ``budget_exceeded`` or ``unsupported_feature``.
    """
    archive = Archive(source.data, budgets)
    vertices = triangles = elements = 0
    for name in archive.names:
        if name.lower().endswith(".model"):
            part = archive.read(name)
            check_xml(part, f"The 3MF model {name[:60]!r}")
            vertices += part.count(b"<vertex ")
            triangles += part.count(b"<triangle ")
            elements += count_elements(part)
    within(vertices, budgets.vertices, "vertices")
    within(triangles, budgets.faces, "triangles")
    within(elements, budgets.vertices + budgets.faces + budgets.xml_elements, "XML elements")
    return archive


def read_3mf(_source: Source, archive: Archive, budgets: Budgets) -> Assembly:
    """A body for each mesh of the build, an instance for each of its uses; the frame has metres and Y up.

    Base materials become materials, colours of colour groups COLOR_0, texture groups TEXCOORD_0 and a texture. Supports
    and a slicer's tools (negative volumes, modifiers, support blockers and enforcers) are left out.

    Raises:
        MeshmarkError: ``malformed_file``, ``no_faces``, ``budget_exceeded``, ``external_reference``, or
            ``unsupported_feature`` for a document type.
    """
    package = Package(archive, budgets)
    start = package.start_part()
    model = package.model(start)
    assembly = Assembly([], [], [], product(_Z_UP, np.diag([model.metres] * 3 + [1.0])))
    tools, left_out = read_tools(archive, budgets, package.tally, assembly.warnings), Counter[str]()
    numbers: dict[Key, int] = {}
    faces = 0
    for key, matrix in _built(package, start, tools, left_out, budgets):
        thing = package.find(key)
        if key not in numbers:
            numbers[key] = len(assembly.bodies)
            body = _mesh(thing, package, key[0], assembly.warnings)
            ranges = tools.ranges.get(key[1], []) if key[0] == start else []
            assembly.bodies.append(_without(body, ranges))
            assembly.names.append(thing.name)
            left_out.update(kind for _, _, kind in ranges)
        faces += len(assembly.bodies[numbers[key]].sizes)
        within(faces, budgets.faces, "triangles")
        assembly.instances.append(Instance(thing.name, numbers[key], matrix))
    if left_out:
        counted = ", ".join(f"{count:,} {kind}" for kind, count in sorted(left_out.items()))
        assembly.warnings.append(
            dropped(f"The 3MF has {counted}: tools for printing and no parts of the model. They are left out.")
        )
    if faces == 0:
        also = " beside tools for printing" if left_out else ""
        listed = f"{len(model.items):,} build items, {len(model.objects):,} objects"
        raise no_faces(f"The 3MF builds no mesh{also} ({listed}).")
    check_pixels([material for body in assembly.bodies for material in body.materials], budgets)
    return assembly


class Package:
    """The model parts of a 3MF, each read at its first use."""

    def __init__(self, archive: Archive, budgets: Budgets) -> None:
        self.archive = archive
        self.budgets = budgets
        self.tally = Tally()
        self._models: dict[str, Model] = {}

    def start_part(self) -> str:
        """The part that the relationships name, else the one of the usual name."""
        targets: list[str] = []

        def relationship(name: str, attributes: dict[str, str]) -> None:
            if name == "Relationship" and attributes.get("Type", "").endswith("/3dmodel"):
                targets.append(attributes.get("Target", ""))

        if (relationships := self.archive.find("_rels/.rels", "")) is not None:
            text = self.archive.read(relationships)
            parse_xml(text, "The list of parts of the 3MF", self.budgets, Handlers(relationship), tally=self.tally)
        for target in (*targets, USUAL_PART):
            if (found := self.archive.find(target.lstrip("/"), "")) is not None:
                return found
        return self.archive.only(".model")

    def model(self, part: str) -> Model:
        """The tables of a part; all parts together keep the budget of unpacked bytes."""
        if part not in self._models:
            what = f"The 3MF model {part[:60]!r}"
            self._models[part] = Model(self.archive.read(part), what, self.budgets, self.tally)
        return self._models[part]

    def key(self, part: str | None, object_id: str, beside: str) -> Key:
        """The object that a component or build item in the part ``beside`` means."""
        if part is None:
            return beside, object_id
        found = self.archive.find(part.lstrip("/"), "")
        if found is None:
            raise malformed(f"The 3MF refers to the part {part[:60]!r}, which is not in the archive.")
        return found, object_id

    def find(self, key: Key) -> Object:
        """An object.

        Raises:
            MeshmarkError: ``malformed_file`` where there is no such object.
        """
        thing = self.model(key[0]).objects.get(key[1])
        if thing is None:
            raise malformed(f"The 3MF builds the object {key[1][:20]!r}, which is not in {key[0][:60]!r}.")
        return thing


def _built(
    package: Package, start: str, tools: Tools, left_out: Counter[str], budgets: Budgets
) -> list[tuple[Key, Float]]:
    """Each mesh of the build, once for each use, in file order, and its matrix to the build.

    ``left_out`` counts the objects and components that are no parts of the model, by kind.
    """
    found: list[tuple[Key, Float]] = []
    pending = [
        (package.key(item.part, item.object_id, start), item.matrix, 0) for item in reversed(package.model(start).items)
    ]
    visits = 0
    while pending:
        key, matrix, depth = pending.pop()
        visits += 1
        within(visits, budgets.nodes, "components, counted each time they are built,")
        if depth > budgets.xml_depth:
            raise malformed(f"The components of the 3MF are nested more than {budgets.xml_depth} deep, or in a circle.")
        thing = package.find(key)
        if thing.kind in OBJECT_TYPES:
            left_out[OBJECT_TYPES[thing.kind]] += 1
            continue
        if len(thing.triangles):
            found.append((key, matrix))
        for part in reversed(thing.components):
            if key[0] == start and (key[1], part.object_id) in tools.parts:
                left_out[tools.parts[key[1], part.object_id]] += 1
            else:
                placed = matrix if part.matrix is IDENTITY else product(matrix, part.matrix)
                pending.append((package.key(part.part, part.object_id, key[0]), placed, depth + 1))
    if not all(np.isfinite(matrix).all() for _, matrix in found):
        raise malformed("The transforms of the 3MF overflow.")
    return found


def _mesh(thing: Object, package: Package, part: str, warnings: list[Notice]) -> PolygonMesh:
    corners = np.frombuffer(thing.triangles, np.int64)
    positions = np.frombuffer(thing.vertices, np.float64).reshape(-1, 3)
    count = len(corners) // 3
    properties = np.frombuffer(thing.properties, np.int64).reshape(-1, 5)
    look = _Look(count)
    lost: Counter[str] = Counter()
    for name, number in thing.groups.items():
        group = package.model(part).groups.get(name)
        rows = properties[properties[:, 1] == number]
        if group is not None and group.kind in _NO_COLOR:
            lost[_NO_COLOR[group.kind]] += len(rows)
        elif group is None or rows[:, 2:].min() < 0 or rows[:, 2:].max() >= len(group.rows):
            lost["colours that are not in the file"] += len(rows)
        elif group.kind == "basematerials":
            look.add_materials(group, rows)
        elif group.kind == "colorgroup":
            look.add_colors(group, rows)
        else:
            path = package.model(part).textures.get(group.texture, "")
            look.add_texture(group, rows, _image(package, path, warnings))
    for what, triangles in lost.items():
        warnings.append(dropped(f"{triangles:,} triangles of {thing.name[:60]!r} have {what}, which are dropped."))
    return PolygonMesh(positions, corners, np.full(count, 3), look.group, look.attributes(), tuple(look.materials))


def _without(mesh: PolygonMesh, ranges: list[tuple[int, int, str]]) -> PolygonMesh:
    """The triangles outside of these ranges of them, first and last included."""
    keep = np.ones(len(mesh.sizes), bool)
    for first, last, _ in ranges:
        keep[first : last + 1] = False
    if keep.all():
        return mesh
    corners = np.repeat(keep, 3)
    attributes = {name: replace(item, index=item.index[corners]) for name, item in mesh.attributes.items()}
    return replace(
        mesh, corners=mesh.corners[corners], sizes=mesh.sizes[keep], group=mesh.group[keep], attributes=attributes
    )


def _image(package: Package, path: str, warnings: list[Notice]) -> bytes | None:
    found = package.archive.find(path.lstrip("/"), "") if path else None
    return usable_image(path, None if found is None else package.archive.read(found), warnings)


class _Look:
    """The materials, colours and texture coordinates of one mesh of ``count`` triangles."""

    def __init__(self, count: int) -> None:
        self.materials = [Material()]
        self.group = np.zeros(count, np.int64)
        self._colors = _Table(count, 4)
        self._coordinates = _Table(count, 2)

    def add_materials(self, group: Group, rows: Int) -> None:
        """Base materials: one for a whole triangle, as the specification demands of its three corners."""
        for row in np.unique(rows[:, 2]).tolist():
            base = group.rows[row]
            red, green, blue, alpha = linear(np.array(_rgba(base.get("displaycolor", "")))).round(6).tolist()
            self.group[rows[rows[:, 2] == row, 0]] = len(self.materials)
            self.materials.append(Material(base.get("name", ""), (red, green, blue, alpha)))

    def add_colors(self, group: Group, rows: Int) -> None:
        """Colours of a colour group, interpolated over the triangle."""
        self._colors.add(np.array([_rgba(row.get("color", "")) for row in group.rows]), rows)

    def add_texture(self, group: Group, rows: Int, image: bytes | None) -> None:
        """Texture coordinates, V upwards, of one texture."""
        self._coordinates.add(np.array([_coordinate(row) for row in group.rows]), rows)
        self.group[rows[:, 0]] = len(self.materials)
        self.materials.append(Material("", texture=image))

    def attributes(self) -> dict[str, Attribute]:
        """The attributes that some triangle has."""
        named = {"COLOR_0": self._colors.attribute(), "TEXCOORD_0": self._coordinates.attribute()}
        return {name: attribute for name, attribute in named.items() if len(attribute.values)}


class _Table:
    """Values that the corners of some triangles have."""

    def __init__(self, count: int, width: int) -> None:
        self._index = np.full((count, 3), -1, np.int64)
        self._values = [np.empty((0, width))]

    def add(self, values: Float, rows: Int) -> None:
        self._index[rows[:, 0]] = rows[:, 2:] + sum(map(len, self._values))
        self._values.append(values)

    def attribute(self) -> Attribute:
        return Attribute(np.concatenate(self._values), self._index.ravel())


def _rgba(text: str) -> tuple[float, float, float, float]:
    """ "#RRGGBB" or "#RRGGBBAA", sRGB, as fractions; grey where it is neither."""
    if not re.fullmatch(r"#[0-9A-Fa-f]{6}(?:[0-9A-Fa-f]{2})?", text.strip()):
        return 0.8, 0.8, 0.8, 1.0
    red, green, blue, alpha = bytes.fromhex(text.strip()[1:].ljust(8, "f"))
    return red / 255, green / 255, blue / 255, alpha / 255


def _coordinate(row: dict[str, str]) -> tuple[float, float]:
    try:
        return float(row["u"]), 1 - float(row["v"])
    except (KeyError, ValueError):
        raise malformed("The 3MF has a texture coordinate that is not two numbers.") from None
