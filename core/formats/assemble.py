"""Bodies of polygons as a GLB document."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bool, Float, Int
from core.errors import ErrorCode, MeshmarkError
from core.formats.assembly import Assembly
from core.formats.polygons import Attribute, Material, PolygonMesh
from core.geometry.products import cross, product
from core.geometry.triangulation import triangulate
from core.geometry.winding import Outward, outward
from core.gltf.builder import Builder
from core.gltf.colors import linear
from core.gltf.document import Document
from core.gltf.images import mime_type
from core.refusals import no_faces, non_finite

# Ratio of coordinate to size; beyond it float32 leaves less than four digits of shape after the decimal point.
FAR_FROM_ORIGIN = 1e3
GREY = (0.8, 0.8, 0.8, 1.0)
WHITE = (1.0, 1.0, 1.0, 1.0)

_ARRAYS = ("nodes", "meshes", "materials", "textures", "images", "accessors", "bufferViews")
_TEXTURE_EXTENSIONS = {"image/webp": "EXT_texture_webp", "image/ktx2": "KHR_texture_basisu"}


def assemble(assembly: Assembly) -> Document:
    """One mesh a body and one node an instance; all under a node of the assembly's frame, where it has one.

    The primitives of a mesh are the material groups of the body, divided where only some faces have normals, texture
    coordinates or colours: nothing is invented, nothing is dropped but vertices that no face uses. Vertices and faces
    keep their order; polygons are triangulated. Coordinates far from the origin are stored relative to the node.
    A matrix that glTF forbids in a node, since it shears, is applied to the positions.

    These formats have no culling: closed components are made to face outwards, normals on the wrong side with them,
    open ones the way of their normals, and a mesh that is not closed throughout is double-sided.

    Raises:
        MeshmarkError: ``no_faces``, ``index_out_of_range`` or ``non_finite_positions``.
    """
    assembler = _Assembler()
    drawn: dict[tuple[int, bytes], tuple[int, Float] | None] = {}
    for instance in assembly.instances:
        body, shear = assembly.bodies[instance.body], b""
        if not is_transform(instance.matrix):
            shear, body = instance.matrix.tobytes(), moved(body, instance.matrix)
        key = instance.body, shear
        if key not in drawn:
            drawn[key] = assembler.mesh(assembly.names[instance.body], body)
        if (mesh := drawn[key]) is not None:
            assembler.node(instance.name, mesh[0], np.eye(4) if shear else instance.matrix, mesh[1])
    if not any(drawn.values()):
        faces = sum(len(body.sizes) for body in assembly.bodies)
        raise no_faces(f"None of the {faces:,} faces of the file has three corners.")
    return replace(assembler.document(assembly.frame), warnings=list(assembly.warnings))


def is_transform(matrix: Float) -> bool:
    """True where a matrix (4, 4) is a translation, rotation and scale: it keeps right angles."""
    columns = matrix[:3, :3]
    angles = np.abs(product(columns.T, columns))
    length = np.sqrt(np.diag(angles))
    return bool(np.all(angles - np.diag(np.diag(angles)) <= 1e-5 * np.outer(length, length)) and np.all(length > 0))


def moved(body: PolygonMesh, matrix: Float) -> PolygonMesh:
    """The body with a matrix (4, 4) applied to it; one that mirrors reverses the polygons."""
    attributes, corners = dict(body.attributes), body.corners
    linear_part = matrix[:3, :3]
    mirrored = np.linalg.det(linear_part) < 0
    if "NORMAL" in attributes:  # by the cofactors, which are the inverse transpose where there is an inverse
        cofactors = np.stack([np.cross(linear_part[i - 2], linear_part[i - 1]) for i in range(3)])
        normals = attributes["NORMAL"]
        attributes["NORMAL"] = Attribute(
            product(normals.values, -cofactors.T if mirrored else cofactors.T), normals.index
        )
    if mirrored:
        start = np.repeat(np.cumsum(body.sizes) - body.sizes, body.sizes)
        size = np.repeat(body.sizes, body.sizes)
        order = start + (start - np.arange(len(corners))) % size  # each polygon backwards from its first corner
        corners = corners[order]
        attributes = {name: Attribute(item.values, item.index[order]) for name, item in attributes.items()}
    positions = product(body.positions, linear_part.T) + matrix[:3, 3]
    return replace(body, positions=positions, corners=corners, attributes=attributes)


def _check_references(index: Int, count: int, what: str) -> None:
    wrong = (index < 0) | (index >= count)
    if wrong.any():
        raise MeshmarkError(
            ErrorCode.INDEX_OUT_OF_RANGE,
            f"{np.count_nonzero(wrong):,} corners of faces refer to a {what} outside the {count:,} of the file.",
            "Repair the mesh and export it again.",
        )


def _usable(name: str, attribute: Attribute) -> Attribute:
    """The attribute as glTF stores it; corners whose value glTF could not store have none."""
    values = attribute.values
    if len(values) == 0:
        return Attribute(values, np.full(len(attribute.index), -1))
    _check_references(attribute.index[attribute.index >= 0], len(values), f"{name} value")
    usable = _fits_float32(values)
    if name == "NORMAL":
        length = np.linalg.norm(values, axis=1, keepdims=True)
        usable = usable & (length[:, 0] > 0)
        values = np.divide(values, length, out=np.zeros_like(values), where=usable[:, None])
    if name == "COLOR_0":
        values = linear(np.clip(values, 0, 1))
    return Attribute(values, np.where(usable[attribute.index], attribute.index, -1))


def _fits_float32(values: Float) -> NDArray[np.bool_]:
    """(N,) rows of (N, n) that hold only finite numbers in the range of float32."""
    return np.asarray(np.all(np.abs(values) <= np.finfo(np.float32).max, axis=1))


def _check_positions(positions: Float, corners: Int) -> None:
    wrong = ~_fits_float32(positions)[corners]
    if wrong.any():
        raise non_finite(
            f"{np.count_nonzero(wrong):,} of {len(corners):,} corners of faces are not at finite positions."
        )


def origin_of(positions: Float) -> Float:
    """(3,) translation of the node: the centre of the asset if float32 would lose its shape, else zero."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    is_far = np.abs(positions).max() > FAR_FROM_ORIGIN * (high - low).max()
    return (low + high) / 2 if is_far and np.any(positions.astype(np.float32) != positions) else np.zeros(3)


def _faced_outwards(body: PolygonMesh, triangles: Int) -> tuple[PolygonMesh, Int, bool]:
    """Triangles (T, 3) of corner numbers with closed components facing outwards, and True if all components are closed.

    Normals that then point away from the front of their face are reversed as well; their corners get numbers of their
    own, so that a body is returned too. The front of open components is that of their normals, where there are some.
    """
    found = outward(body.positions, body.corners[triangles])
    triangles = _reversed(triangles, found.flipped)
    if "NORMAL" in body.attributes and len(body.attributes["NORMAL"].values):
        against = _against_normals(body, triangles, found)
        triangles = _reversed(triangles, against & ~found.closed)
        if np.any(against & found.closed):
            body, triangles = _with_normals_turned(body, triangles, against & found.closed)
    return body, triangles, bool(found.closed.all())


def _reversed(triangles: Int, which: Bool) -> Int:
    return np.where(which[:, None], triangles[:, [0, 2, 1]], triangles)


def _against_normals(body: PolygonMesh, triangles: Int, found: Outward) -> Bool:
    """(T,) the triangles that are wound against their normals.

    The flipped triangles of a component are taken together, and so are its others: slivers and sharp edges may have
    normals on either side.
    """
    normals = body.attributes["NORMAL"]
    index = normals.index[triangles]
    a, b, c = (body.positions[body.corners[triangles[:, corner]]] for corner in range(3))
    mean = np.where((index >= 0)[..., None], normals.values[index], 0.0).sum(axis=1)
    group = 2 * (found.component + 1) + found.flipped
    side = np.bincount(group, np.einsum("ni,ni->n", cross(b - a, c - a), mean))
    return np.asarray(side[group] < 0)


def _with_normals_turned(body: PolygonMesh, triangles: Int, which: Bool) -> tuple[PolygonMesh, Int]:
    """The body with a corner of its own for each corner of the triangles, and the normals of some of them reversed."""
    old = triangles.ravel()
    attributes = {name: replace(item, index=item.index[old]) for name, item in body.attributes.items()}
    normals = attributes["NORMAL"]
    turned = np.repeat(which, 3) & (normals.index >= 0)
    attributes["NORMAL"] = Attribute(
        np.concatenate([normals.values, -normals.values]), normals.index + turned * len(normals.values)
    )
    return replace(body, corners=body.corners[old], attributes=attributes), np.arange(len(old)).reshape(-1, 3)


def _shared_vertices(columns: list[Int]) -> tuple[Int, Int]:
    """Number equal rows of index columns (C,): the first row of each number, in order of the first column, and (C,)."""
    code = columns[0]
    for column in columns[1:]:
        if not np.array_equal(column, columns[0]):
            code = np.unique(code, return_inverse=True)[1] * (int(column.max()) + 1) + column
    _, first, number = np.unique(code, return_index=True, return_inverse=True)
    return first, number


class _Assembler:
    """Adds the nodes, meshes and materials of an assembly to an empty document."""

    def __init__(self) -> None:
        asset = {"version": "2.0", "generator": "meshmark"}
        self._builder = Builder(Document({"asset": asset, "scene": 0, "scenes": [{"nodes": []}]}, b""))
        self._builder.json |= {name: [] for name in _ARRAYS}  # in the order of the specification
        self._extensions: set[str] = set()
        self._numbers: dict[Any, int] = {}  # of materials and images, by their content

    def mesh(self, name: str, body: PolygonMesh) -> tuple[int, Float] | None:
        """Add a body; returns its number and the point (3,) it is stored relative to; ``None`` without triangles."""
        _check_references(body.corners, len(body.positions), "vertex")
        _check_positions(body.positions, body.corners)
        triangles, polygon = triangulate(body.positions, body.corners, body.sizes)
        if len(triangles) == 0:
            return None
        attributes = {name: _usable(name, attribute) for name, attribute in body.attributes.items()}
        body, triangles, closed = _faced_outwards(replace(body, attributes=attributes), triangles)
        attributes = body.attributes
        origin = origin_of(body.positions[body.corners[triangles.ravel()]])
        kind = body.group[polygon] << len(attributes)
        for bit, attribute in enumerate(attributes.values()):
            kind |= np.all(attribute.index[triangles] >= 0, axis=1).astype(np.int64) << bit
        order = np.argsort(kind, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(kind[order])) + 1)
        primitives = []
        for rows in sorted(groups, key=lambda rows: int(rows[0])):
            value = int(kind[rows[0]])
            present = {name: item for bit, (name, item) in enumerate(attributes.items()) if value >> bit & 1}
            material = self.material(
                body.materials[value >> len(attributes)], "COLOR_0" in present, "TEXCOORD_0" in present, not closed
            )
            primitives.append(
                self.primitive(body, triangles[rows], present, origin) | {"material": material, "mode": 4}
            )
        return self._builder.append("meshes", {"name": name, "primitives": primitives}), origin

    def primitive(
        self, mesh: PolygonMesh, corners: Int, attributes: dict[str, Attribute], origin: Float
    ) -> dict[str, Any]:
        """The triangles (T, 3) of corner numbers as attributes and indices."""
        used = corners.ravel()
        first, vertices = _shared_vertices([mesh.corners[used], *(item.index[used] for item in attributes.values())])
        rows = used[first]
        position = (mesh.positions[mesh.corners[rows]] - origin).astype(np.float32)
        semantics = {"POSITION": self._builder.add_accessor(position, "VEC3", bounded=True)}
        for name, item in attributes.items():
            values = item.values[item.index[rows]]
            if name == "COLOR_0":  # 16 bits, since 8 would lose the dark linear ones
                values = np.rint(values * 65535).astype(np.uint16)
                semantics[name] = self._builder.add_accessor(values, "VEC4", normalized=True)
            else:
                semantics[name] = self._builder.add_accessor(values.astype(np.float32), f"VEC{values.shape[1]}")
        indices = self._builder.add_indices(vertices, np.dtype("<u2"))
        return {"attributes": semantics, "indices": indices}

    def material(self, material: Material, colored: bool, mapped: bool, double_sided: bool) -> int:
        """The number of a material; a neutral one is white where vertex colours multiply it."""
        key = material, colored, mapped, double_sided
        if key not in self._numbers:
            neutral = WHITE if colored or (mapped and material.texture) else GREY
            surface: dict[str, Any] = {
                "baseColorFactor": list(material.color or neutral),
                "metallicFactor": material.metallic,
                "roughnessFactor": material.roughness,
            }
            entry: dict[str, Any] = {"name": material.name} if material.name else {}
            entry |= {"pbrMetallicRoughness": surface, "doubleSided": double_sided}
            if mapped and material.texture is not None:
                surface["baseColorTexture"] = {"index": self.texture(material.texture)}
            if mapped and material.normal_map is not None:
                entry["normalTexture"] = {"index": self.texture(material.normal_map)}
            if any(material.emissive):
                entry["emissiveFactor"] = list(material.emissive)
            if material.masked:
                entry["alphaMode"] = "MASK"
            elif surface["baseColorFactor"][3] < 1:
                entry["alphaMode"] = "BLEND"
            self._numbers[key] = self._builder.append("materials", entry)
        return self._numbers[key]

    def texture(self, image: bytes) -> int:
        """The number of the texture of an encoded image, whose bytes are stored as they are."""
        if image not in self._numbers:
            mime = mime_type(image)
            assert mime is not None, "the readers drop what glTF cannot carry"
            view = self._builder.add_view(image, {})
            source: dict[str, Any] = {"source": self._builder.append("images", {"bufferView": view, "mimeType": mime})}
            if mime in _TEXTURE_EXTENSIONS:
                self._extensions.add(_TEXTURE_EXTENSIONS[mime])
                source = {"extensions": {_TEXTURE_EXTENSIONS[mime]: source}}
            self._numbers[image] = self._builder.append("textures", source)
        return self._numbers[image]

    def node(self, name: str, mesh: int, matrix: Float, origin: Float) -> None:
        """Add a node that draws a mesh stored relative to ``origin``."""
        node: dict[str, Any] = {"name": name, "mesh": mesh}
        rotated, place = matrix[:3, :3], product(matrix[:3, :3], origin[:, None])[:, 0] + matrix[:3, 3]
        if not np.array_equal(rotated, np.eye(3)):
            node["matrix"] = _column_major(rotated, place)
        elif place.any():
            node["translation"] = place.tolist()
        self._builder.append("nodes", node)

    def document(self, frame: Float) -> Document:
        """The document so far, under a node of this ``frame`` (4, 4) if it is not the identity.

        Raises:
        """
        json = self._builder.json = {name: value for name, value in self._builder.json.items() if value != []}
        roots = list(range(len(json.get("nodes", []))))
        if not np.array_equal(frame, np.eye(4)):
            matrix = _column_major(frame[:3, :3], frame[:3, 3])
            roots = [self._builder.append("nodes", {"name": "model", "matrix": matrix, "children": roots})]
        json["scenes"][0]["nodes"] = roots
        if self._extensions:
            json["extensionsUsed"] = json["extensionsRequired"] = sorted(self._extensions)
        return self._builder.to_document()


def _column_major(linear_part: Float, translation: Float) -> list[float]:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear_part, translation
    return [float(value) for value in matrix.T.ravel()]
