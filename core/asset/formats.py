"""Every accepted format as a GLB document."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.asset.budgets import DEFAULT_BUDGETS, Budgets
from core.asset.gltf import Document
from core.asset.obj import read_obj
from core.asset.off import read_off
from core.asset.ply import read_ply
from core.asset.polygons import Attribute, Float, Int, PolygonMesh, triangulate, weld
from core.asset.refusals import no_faces, non_finite
from core.asset.sniff import Format
from core.asset.stl import read_stl
from core.errors import ErrorCode, MeshmarkError

# Beyond this ratio of coordinate to size, float32 leaves less than four digits of shape after the decimal point.
FAR_FROM_ORIGIN = 1e3
GREY = [0.8, 0.8, 0.8, 1.0]
WHITE = [1.0, 1.0, 1.0, 1.0]

_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_RESTART_INDEX = 2**16 - 1  # the largest uint16 is reserved by glTF


def to_document(data: bytes, file_format: Format, budgets: Budgets = DEFAULT_BUDGETS) -> Document:
    """The asset as a GLB document; a GLB is taken as it is.

    The other formats become one node with one mesh. Its primitives are the material groups of the file, divided where
    only some faces have normals, texture coordinates or colours: nothing is invented, nothing is dropped but vertices
    that no face uses. Vertices and faces keep the order of the file; polygons are triangulated. Alpha is carried in
    COLOR_0 and not drawn. Coordinates far from the origin are stored relative to the node's translation.

    Args:
        data: a file that :func:`core.asset.gate.admit` let pass.
        file_format: what it returned.
        budgets: bounds the triangles of polygons, which no header declares.

    Raises:
        MeshmarkError: ``malformed_file``, ``truncated_file``, ``no_faces``, ``index_out_of_range``,
            ``non_finite_positions`` or ``budget_exceeded``.
    """
    if file_format is Format.GLB:
        return Document.from_glb(data)
    return _build(_read(data, file_format, budgets))


def _read(data: bytes, file_format: Format, budgets: Budgets) -> PolygonMesh:
    match file_format:
        case Format.OBJ:
            return read_obj(data, budgets)
        case Format.STL:
            return read_stl(data)
        case Format.PLY:
            return read_ply(data, budgets)
        case Format.OFF:
            return read_off(data, budgets)
        case Format.GLB:
            raise AssertionError("a GLB is a document already")


def _build(mesh: PolygonMesh) -> Document:
    _check_references(mesh.corners, len(mesh.positions), "vertex")
    _check_positions(mesh.positions, mesh.corners)
    triangles, polygon = triangulate(mesh.positions, mesh.corners, mesh.sizes)
    if len(triangles) == 0:
        raise no_faces(f"None of the {len(mesh.sizes):,} faces of the file has three corners.")
    attributes = {name: _usable(name, attribute) for name, attribute in mesh.attributes.items()}
    vertices = mesh.corners[triangles]
    origin = _origin(mesh.positions[vertices.ravel()])
    writer = _Writer(double_sided=not _is_closed(mesh.positions, vertices))
    kind = mesh.group[polygon] << len(attributes)
    for bit, attribute in enumerate(attributes.values()):
        kind |= np.all(attribute.index[triangles] >= 0, axis=1).astype(np.int64) << bit
    order = np.argsort(kind, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(kind[order])) + 1)
    for rows in sorted(groups, key=lambda rows: int(rows[0])):
        value = int(kind[rows[0]])
        present = {name: item for bit, (name, item) in enumerate(attributes.items()) if value >> bit & 1}
        writer.primitive(mesh, triangles[rows], present, mesh.materials[value >> len(attributes)], origin)
    return writer.document(origin)


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
        values = np.clip(values, 0, 1)  # sRGB in files, linear in glTF
        linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
        values = np.column_stack([linear[:, :3], values[:, 3]])
    return Attribute(values, np.where(usable[attribute.index], attribute.index, -1))


def _fits_float32(values: Float) -> NDArray[np.bool_]:
    """(N,) which rows of (N, n) hold only finite numbers in the range of float32."""
    return np.asarray(np.all(np.abs(values) <= np.finfo(np.float32).max, axis=1))


def _check_positions(positions: Float, corners: Int) -> None:
    wrong = ~_fits_float32(positions)[corners]
    if wrong.any():
        raise non_finite(
            f"{np.count_nonzero(wrong):,} of {len(corners):,} corners of faces are not at finite positions."
        )


def _origin(positions: Float) -> Float:
    """(3,) where the node stands: the middle of the asset if float32 would lose its shape, else zero."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    is_far = np.abs(positions).max() > FAR_FROM_ORIGIN * (high - low).max()
    return (low + high) / 2 if is_far and np.any(positions.astype(np.float32) != positions) else np.zeros(3)


def _is_closed(positions: Float, vertices: Int) -> bool:
    """Whether every edge of the triangles (T, 3) has at least two of them, equal positions being one vertex."""
    return _has_no_boundary(vertices) or _has_no_boundary(weld(positions)[vertices])


def _has_no_boundary(vertices: Int) -> bool:
    edges = np.sort(np.concatenate([vertices[:, [0, 1]], vertices[:, [1, 2]], vertices[:, [2, 0]]]), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    _, count = np.unique(edges[:, 0] * (int(vertices.max()) + 1) + edges[:, 1], return_counts=True)
    return bool(np.all(count > 1))


def _shared_vertices(columns: list[Int]) -> tuple[Int, Int]:
    """Number equal rows of index columns (C,): the first row of each number, in order of the first column, and (C,)."""
    code = columns[0]
    for column in columns[1:]:
        if not np.array_equal(column, columns[0]):
            code = np.unique(code, return_inverse=True)[1] * (int(column.max()) + 1) + column
    _, first, number = np.unique(code, return_index=True, return_inverse=True)
    return first, number


class _Writer:
    """Gathers primitives, accessors and bytes into a document."""

    def __init__(self, double_sided: bool) -> None:
        self.double_sided = double_sided
        self.binary = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self.material_numbers: dict[tuple[str, bool], int] = {}
        self.primitives: list[dict[str, Any]] = []

    def primitive(
        self, mesh: PolygonMesh, corners: Int, attributes: dict[str, Attribute], material: str, origin: Float
    ) -> None:
        """Add the triangles (T, 3) of corner numbers as one primitive."""
        used = corners.ravel()
        first, vertices = _shared_vertices([mesh.corners[used], *(item.index[used] for item in attributes.values())])
        rows = used[first]
        position = (mesh.positions[mesh.corners[rows]] - origin).astype(np.float32)
        semantics = {"POSITION": self.accessor(position, "VEC3", bounds=True)}
        for name, item in attributes.items():
            values = item.values[item.index[rows]]
            if name == "COLOR_0":  # 16 bits, since 8 would lose the dark linear ones
                semantics[name] = self.accessor(np.rint(values * 65535).astype(np.uint16), "VEC4", normalized=True)
            else:
                semantics[name] = self.accessor(values.astype(np.float32), f"VEC{values.shape[1]}")
        index_type = np.uint16 if len(rows) <= _RESTART_INDEX else np.uint32
        indices = self.accessor(vertices.astype(index_type), "SCALAR", target=_ELEMENT_ARRAY_BUFFER)
        number = self.material(material, "COLOR_0" in attributes)
        self.primitives.append({"attributes": semantics, "indices": indices, "material": number, "mode": 4})

    def material(self, name: str, colored: bool) -> int:
        """The neutral material of this name; white where vertex colours multiply it."""
        if (name, colored) not in self.material_numbers:
            self.material_numbers[name, colored] = len(self.materials)
            color = WHITE if colored else GREY
            surface = {"baseColorFactor": color, "metallicFactor": 0.0, "roughnessFactor": 0.7}
            material: dict[str, Any] = {"name": name} if name else {}
            self.materials.append(material | {"pbrMetallicRoughness": surface, "doubleSided": self.double_sided})
        return self.material_numbers[name, colored]

    def accessor(
        self,
        values: NDArray[Any],
        kind: str,
        target: int = _ARRAY_BUFFER,
        bounds: bool = False,
        normalized: bool = False,
    ) -> int:
        """Append values as a buffer view of their own; returns the accessor's number."""
        component = {np.dtype(np.uint16): 5123, np.dtype(np.uint32): 5125, np.dtype(np.float32): 5126}[values.dtype]
        payload = values.tobytes()
        self.views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(payload), "target": target})
        self.binary += payload + bytes(-len(payload) % 4)
        accessor = {"bufferView": len(self.views) - 1, "componentType": component, "count": len(values), "type": kind}
        if bounds:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        if normalized:
            accessor["normalized"] = True
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def document(self, origin: Float) -> Document:
        """Everything gathered so far, drawn by one node at ``origin``."""
        node: dict[str, Any] = {"name": "model", "mesh": 0}
        if origin.any():
            node["translation"] = origin.tolist()
        return Document(
            {
                "asset": {"version": "2.0", "generator": "meshmark"},
                "scene": 0,
                "scenes": [{"nodes": [0]}],
                "nodes": [node],
                "meshes": [{"name": "model", "primitives": self.primitives}],
                "materials": self.materials,
                "accessors": self.accessors,
                "bufferViews": self.views,
                "buffers": [{"byteLength": len(self.binary)}],
            },
            bytes(self.binary),
        )
