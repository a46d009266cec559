"""COLLADA (DAE), alone or in an archive with its textures, loaded by trimesh."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np

from core.arrays import Float
from core.budgets import Budgets
from core.errors import ErrorCode
from core.formats.assembly import Assembly, Instance, dropped
from core.formats.dae_prepare import prepare
from core.formats.dae_scan import Scan
from core.formats.polygons import Attribute, Material, PolygonMesh
from core.formats.source import Source
from core.formats.textures import check_pixels, usable_image
from core.geometry.grouping import weld
from core.geometry.products import product
from core.gltf.colors import linear
from core.notices import Notice
from core.refusals import malformed, no_faces

Load = Callable[[str], bytes | None]

_UP = {
    "X_UP": np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
    "Y_UP": np.eye(4),
    "Z_UP": np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]),
}


def check_dae(source: Source, budgets: Budgets) -> Scan:
    """Refuse a DAE that draws nothing, or is beyond the budgets.

    Returns:
        Its scene as far as it is declared.

    Raises:
        MeshmarkError: ``malformed_file``, ``no_faces``, ``budget_exceeded`` or ``unsupported_feature``.
    """
    scan = Scan(source.data, budgets)
    if scan.drawn == 0:
        raise no_faces(scan.why_nothing_is_drawn)
    return scan


def read_dae(source: Source, scan: Scan, budgets: Budgets) -> Assembly:
    """A body and an instance for each set of polygons that the scene of a DAE draws.

    Carried are positions, normals, the first UV set, colours of vertices, and of materials the colour, texture, normal
    map and transparency, in all conventions. Skins and morphs are drawn in their bind pose, without joints and targets;
    animations, cameras and lights are not carried.

    Args:
        source: the file.
        scan: from :func:`check_dae`.
        budgets: bounds the pixels of textures.

    Raises:
        MeshmarkError: ``malformed_file``, ``no_faces`` or ``budget_exceeded``.
    """
    # Imported here because it takes half a second, for this format only.
    from trimesh.exchange.dae import load_collada

    warnings: list[Notice] = []
    images = _Images(source.load, warnings)
    prepared = prepare(source.data, warnings)
    try:
        with np.errstate(all="ignore"):
            loaded = load_collada(io.BytesIO(prepared), resolver=images)  # type: ignore[no-untyped-call]
    except Exception as error:  # pycollada raises errors of all kinds on malformed files
        raise malformed(f"The DAE cannot be read ({type(error).__name__}: {str(error)[:100]}).") from None
    assembly = Assembly([], [], [], product(_UP[scan.up_axis], np.diag([scan.metres] * 3 + [1.0])), warnings)
    for use in loaded["graph"]:
        key = use["geometry"]
        body = _body(loaded["geometry"][key], images)
        matrix = np.asarray(use["matrix"], np.float64)
        if not np.isfinite(matrix).all():
            raise malformed("The DAE has a transform that is not finite.")
        name = scan.names.get(key) or scan.names.get(key.rpartition("_")[0]) or key
        assembly.instances.append(Instance(name, len(assembly.bodies), matrix))
        assembly.bodies.append(body)
        assembly.names.append(name)
    if scan.has_controllers:
        warnings.append(
            dropped("The DAE has skinned or morphing meshes; they are kept in bind pose, without joints and targets.")
        )
    for what in sorted(scan.not_read):
        warnings.append(dropped(f"The DAE has {what}, which are not read."))
    if not assembly.bodies:
        raise no_faces(scan.why_nothing_is_drawn)
    if len(assembly.bodies) < scan.drawn:
        missing = scan.drawn - len(assembly.bodies)
        warnings.append(dropped(f"{missing:,} of {scan.drawn:,} sets of polygons of the DAE are damaged, and dropped."))
    check_pixels([material for body in assembly.bodies for material in body.materials], budgets)
    return assembly


class _Images:
    """Placeholders of the textures: trimesh gets an empty image whose width is a number, so that it decodes nothing.

    Images are never re-encoded, and trimesh keeps them decoded only.
    """

    def __init__(self, load: Load, warnings: list[Notice]) -> None:
        self._load = load
        self._warnings = warnings
        self._loaded: dict[str, bytes | None] = {}

    def get(self, path: str) -> bytes:
        """Called by trimesh, which takes any exception for a texture that is not there."""
        from PIL import Image

        if path not in self._loaded:
            content = self._load(path)
            if content is None and ":/" in path:
                self._loaded[path] = None
                self._warnings.append(
                    Notice(
                        ErrorCode.EXTERNAL_REFERENCE,
                        f"The texture {path[:60]!r} lies outside the uploaded file; it was not opened.",
                        "Send the DAE in a ZIP archive with its textures.",
                    )
                )
            else:
                self._loaded[path] = usable_image(path, content, self._warnings)
        if self._loaded[path] is None:
            raise KeyError(path)
        stream = io.BytesIO()
        Image.new("1", (1 + list(self._loaded).index(path), 1)).save(stream, "PNG")
        return stream.getvalue()

    def of(self, placeholder: Any) -> bytes | None:
        """The encoded image of a placeholder."""
        return None if placeholder is None else list(self._loaded.values())[placeholder.width - 1]


def _body(geometry: dict[str, Any], images: _Images) -> PolygonMesh:
    """One set of triangles; trimesh gives every corner a vertex of its own."""
    positions = np.asarray(geometry["vertices"], np.float64)
    corners = weld(positions)
    attributes: dict[str, Attribute] = {}
    material = Material()
    if geometry["vertex_normals"] is not None:
        attributes["NORMAL"] = _attribute(np.asarray(geometry["vertex_normals"], np.float64))
    if (visual := geometry["visual"]) is not None:
        if visual.uv is not None:
            uv = np.asarray(visual.uv, np.float64)
            attributes["TEXCOORD_0"] = _attribute(np.column_stack([uv[:, 0], 1 - uv[:, 1]]))
        material = _material(visual.material, images)
    if geometry["vertex_colors"] is not None:
        colors = np.asarray(geometry["vertex_colors"], np.float64)
        if colors.shape[1] >= 3:
            opaque = np.column_stack([colors[:, :3], np.ones(len(colors))])
            attributes["COLOR_0"] = _attribute(colors if colors.shape[1] == 4 else opaque)
    count = len(positions) // 3
    return PolygonMesh(positions, corners, np.full(count, 3), np.zeros(count, np.int64), attributes, (material,))


def _attribute(values: Float) -> Attribute:
    return Attribute(values, weld(values))


def _material(found: Any, images: _Images) -> Material:
    color = np.asarray(found.baseColorFactor)
    fractions = color / 255 if color.dtype.kind == "u" else color.astype(np.float64)
    red, green, blue, alpha = linear(np.clip(fractions, 0, 1)).round(6).tolist()
    texture = images.of(found.baseColorTexture)
    return Material(
        color=(1.0, 1.0, 1.0, alpha) if texture else (red, green, blue, alpha),
        roughness=float(np.clip(found.roughnessFactor, 0, 1)),
        texture=texture,
        normal_map=images.of(found.normalTexture),
    )
