"""A DAE rewritten for its loader: skins and morphs at rest, transparency in one convention."""

from xml.etree import ElementTree

import numpy as np

from core.arrays import Float
from core.formats.assembly import dropped
from core.formats.dae_scan import CONTROLLER_DEPTH
from core.notices import Notice

_NOT_LOADED = ("library_controllers", "library_animations", "library_animation_clips", "library_physics_scenes")
_LUMINANCE = np.array([0.212671, 0.715160, 0.072169])  # weights of linear RGB (COLLADA 1.5, "Determining Transparency")


def prepare(data: bytes, warnings: list[Notice]) -> bytes:
    """The same scene without elements that the loader cannot read, or would refuse a whole file for.

    A skin becomes its geometry in bind pose: its bind shape matrix applied, at the root of the scene, since its joints
    place it and not its node. A morph becomes its base geometry in the place of its node. Each transparency becomes an
    alpha.

    Args:
        data: XML that :class:`core.formats.dae_scan.Scan` has let pass.
        warnings: losses are appended.
    """
    if not any(word in data for word in (b"controller", b"animation", b"transparen")):
        return data
    root = ElementTree.fromstring(data)
    space = root.tag.rpartition("COLLADA")[0]
    controllers = _Controllers(root, space)
    for scene in root.iter(f"{space}visual_scene"):
        controllers.place(scene)
    for library in root.iter(f"{space}library_nodes"):
        for node in library.findall(f"{space}node"):
            controllers.place(node)
    for name in _NOT_LOADED:
        for library in root.findall(f"{space}{name}"):
            root.remove(library)
    textured = sum(_set_alpha(shader, space) for shader in _shaders(root, space))
    if textured:
        warnings.append(
            dropped(f"{textured:,} materials of the DAE are transparent where a texture is, which is not read.")
        )
    return bytes(ElementTree.tostring(root, "utf-8"))


class _Controllers:
    """The skins and morphs of a DAE, by id."""

    def __init__(self, root: ElementTree.Element, space: str) -> None:
        self._space = space
        self._found: dict[str, tuple[str, ElementTree.Element]] = {}
        for controller in root.iter(f"{space}controller"):
            for kind in ("skin", "morph"):
                if (entry := controller.find(f"{space}{kind}")) is not None:
                    self._found[controller.get("id", "")] = kind, entry

    def place(self, top: ElementTree.Element) -> None:
        """Let each node below ``top`` draw the geometries of its controllers; those of skins move to ``top``."""
        controlled = f"{self._space}instance_controller"
        for parent in list(top.iter()):
            for use in parent.findall(controlled):
                geometry, matrix = self._geometry(use.get("url", "").removeprefix("#"))
                use.tag = f"{self._space}instance_geometry"
                use.set("url", f"#{geometry}")
                for skeleton in use.findall(f"{self._space}skeleton"):
                    use.remove(skeleton)
                if matrix is not None:
                    parent.remove(use)
                    node = ElementTree.SubElement(top, f"{self._space}node")
                    ElementTree.SubElement(node, f"{self._space}matrix").text = " ".join(
                        map(repr, matrix.ravel().tolist())
                    )
                    node.append(use)

    def _geometry(self, key: str) -> tuple[str, Float | None]:
        """The geometry at the end of a chain of controllers, and the matrix (4, 4) of its skins; ``None`` without a
        skin."""
        matrix: Float | None = None
        for _ in range(CONTROLLER_DEPTH):
            if key not in self._found:
                break
            kind, entry = self._found[key]
            if kind == "skin":
                shape = _numbers(entry.find(f"{self._space}bind_shape_matrix"))
                own = shape.reshape(4, 4) if len(shape) == 16 else np.eye(4)
                matrix = own if matrix is None else matrix @ own
            key = entry.get("source", "").removeprefix("#")
        return key, matrix


def _shaders(root: ElementTree.Element, space: str) -> list[ElementTree.Element]:
    names = {f"{space}{name}" for name in ("constant", "lambert", "phong", "blinn")}
    return [element for element in root.iter() if element.tag in names]


def _set_alpha(shader: ElementTree.Element, space: str) -> bool:
    """Replace the transparency of a shader by an alpha; returns True where it comes from a texture, which is lost."""
    transparent, transparency = (shader.find(f"{space}{name}") for name in ("transparent", "transparency"))
    color, mode, textured = np.ones(4), "A_ONE", False
    if transparent is not None:
        mode = transparent.get("opaque", "A_ONE")
        textured = transparent.find(f"{space}texture") is not None
        found = _numbers(transparent.find(f"{space}color"))
        color[: len(found[:4])] = found[:4]
        shader.remove(transparent)
    amount = np.ones(1)
    if transparency is not None:
        amount = _numbers(transparency.find(f"{space}float"))
        shader.remove(transparency)
    if textured or (transparent is None and transparency is None):
        return textured
    alpha = _alpha(color, float(amount[0]) if len(amount) else 1.0, mode)
    if alpha < 1:
        element = ElementTree.SubElement(shader, f"{space}transparent", opaque="A_ONE")
        ElementTree.SubElement(element, f"{space}color").text = f"1 1 1 {alpha!r}"
    return False


def _alpha(color: Float, amount: float, mode: str) -> float:
    """Opacity of a material, 0 to 1 (COLLADA 1.5, "Determining Transparency").

    A material that would be invisible everywhere comes from exporters that confuse the conventions (a lone transparency
    of 0, as in 3ds Max), and is opaque.
    """
    share = amount * (float(color[:3] @ _LUMINANCE) if mode.startswith("RGB") else float(color[3]))
    alpha = 1 - share if mode.endswith("ZERO") else share
    return min(alpha, 1.0) if alpha > 1e-3 else 1.0


def _numbers(element: ElementTree.Element | None) -> Float:
    """The numbers (N,) in an element; none where it is missing or has other content."""
    text = "" if element is None else element.text or ""
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        return np.empty(0)
    return values if np.isfinite(values).all() else np.empty(0)
