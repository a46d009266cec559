"""What a viewer draws of a scene (glTF 2.0): which faces at all, from which sides, and which it looks through.

Everything that asks what is seen asks here: the frame of the surface, the ground that watermarks stand on, the rays of
placement, embossing and metrics, and the check of the written file.

- A node that KHR_node_visibility hides, or that hangs below one, draws nothing.
- A material that is not ``doubleSided`` shows the front of its faces only (3.9.5): counter-clockwise, and clockwise
  where the node's determinant is negative (3.7.4). A :class:`~core.geometry.surface.Surface` has its faces wound so.
- Effective alpha, factor x texture x COLOR_0, counts where ``alphaMode`` says so (3.9.4), not what ``alphaMode`` says:
  exporters write BLEND on opaque bodies. What is clear everywhere is not drawn.
- A node that flattens its mesh to a line or a point, as a scale of 0 does, draws nothing.

What lights do to a colour is no matter of this module: see :mod:`core.gltf.materials`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.products import cross
from core.gltf.attributes import Points
from core.gltf.base_color import base_color
from core.gltf.document import Document
from core.gltf.hierarchy import hidden_nodes
from core.gltf.materials import Material, read_material
from core.gltf.textures import read_texture

if TYPE_CHECKING:
    from core.geometry.surface import Surface
    from core.gltf.scene import DrawnPrimitive


# Alpha from which a blended surface hides what is behind it, and from which on it is seen at all.
OPAQUE, CLEAR = 0.9, 0.02
# Points that a primitive's alpha is looked at, at least and at most so many on each triangle, so many at a time.
SAMPLES, FEWEST, MOST, AT_A_TIME = 100_000, 3, 200, 200_000
TEXTURE_LIMIT, TEXTURES_KEPT = 1024, 8  # pixels a side; decoded at a time, 4 MiB each
NEEDLE = 1e-7  # height over length below which a triangle is a line: it has no area but that of rounding errors


@dataclass(frozen=True, eq=False)
class Viewed:
    """What a viewer draws of F faces.

    Attributes:
        drawn: (F,) bool, faces that are there to be seen. Where the file hides all of them, all are.
        one_sided: (F,) bool, faces that are drawn from their front only.
        opacity: (F,) share of each face's area that hides what is behind it, 0 to 1.
    """

    drawn: Bool
    one_sided: Bool
    opacity: Float


def viewed(document: Document, surface: "Surface", primitives: "Sequence[DrawnPrimitive]") -> Viewed:
    """What a viewer draws of the faces of a scene's ``surface``, those of one of ``primitives`` after the other.

    Raises:
        MeshmarkError: ``malformed_file`` for materials that are not well formed or refer to what does not exist.
    """
    look = Look(document)
    parts = [(look.drawn(one, one.triangles), one) for one in primitives]
    drawn = np.concatenate([seen for (seen, _), _ in parts])
    for number in [number for number, one in enumerate(primitives) if not one.invertible]:
        mine = np.flatnonzero(surface.face_primitive == number)
        drawn[mine] &= has_area(surface.positions[surface.faces[mine]]).any()
    # Beyond the frame lies only what has no area.
    if np.abs(surface.positions).max() > surface.reach:
        drawn &= (np.abs(surface.positions[surface.faces]) <= surface.reach).all(axis=(1, 2))
    if not drawn.any():
        drawn[:] = True
    one_sided = np.array([not look.material(one).double_sided for one in primitives])
    return Viewed(drawn, one_sided[surface.face_primitive], np.concatenate([opacity for (_, opacity), _ in parts]))


def drawn_part(surface: "Surface", drawn: Bool) -> "Surface":
    """The surface with the faces that are not ``drawn`` (F,) collapsed to their first corner: no face changes its
    number, but samples, areas and rays find only those that are there to be seen."""
    if drawn.all():
        return surface
    return replace(surface, faces=np.where(drawn[:, None], surface.faces, surface.faces[:, :1]))


@np.errstate(over="ignore", invalid="ignore")  # what overflows is no triangle to be seen
def has_area(corners: Float) -> Bool:
    """(F,) which of the triangles ``corners`` (F, 3, 3) are more than points and lines."""
    a, b, c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1], corners[:, 0] - corners[:, 2]
    longest = np.maximum(np.maximum((a * a).sum(axis=1), (b * b).sum(axis=1)), (c * c).sum(axis=1))
    return np.asarray(np.linalg.norm(cross(a, b), axis=1) > NEEDLE * longest)


class Look:
    """The looks of a document's primitives; materials and textures are read once, when first asked for."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._hidden = hidden_nodes(document)
        texture = lru_cache(TEXTURES_KEPT)(partial(read_texture, document, limit=TEXTURE_LIMIT))
        self._plain = lru_cache(None)(partial(read_material, document, read_texture=lambda _: None))
        self._textured = lru_cache(TEXTURES_KEPT)(partial(read_material, document, read_texture=texture))
        self._whole: dict[tuple[int, int], tuple[Bool, Float]] = {}  # by mesh and primitive: nodes may share them

    def material(self, one: "DrawnPrimitive") -> Material:
        """The material of a primitive, without its texture."""
        return self._plain(self._entry(one).get("material"))

    def drawn(self, one: "DrawnPrimitive", triangles: Int) -> tuple[Bool, Float]:
        """Which of some ``triangles`` (T, 3: accessor rows) of a primitive are drawn (T,), and the opacity of each
        (T,): see :class:`Viewed`. Collapsed ones count as drawn."""
        if one.node in self._hidden:
            return np.zeros(len(triangles), dtype=bool), np.ones(len(triangles))
        if len(triangles) < len(one.triangles):
            return self._by_alpha(one, triangles)
        key = one.mesh, one.primitive
        if key not in self._whole:
            self._whole[key] = self._by_alpha(one, triangles)
        return self._whole[key]

    def opaque_at(self, one: "DrawnPrimitive", points: Points) -> Bool:
        """(C,) whether a primitive hides what is behind it at each of ``points``."""
        return self._opaque(self.material(one), self._alpha(one, points))

    def may_be_seen_through(self, one: "DrawnPrimitive") -> bool:
        """Whether alpha matters to a primitive at all."""
        return self.material(one).alpha_mode != "OPAQUE"

    def _by_alpha(self, one: "DrawnPrimitive", triangles: Int) -> tuple[Bool, Float]:
        material = self.material(one)
        if material.alpha_mode == "OPAQUE":
            return np.ones(len(triangles), dtype=bool), np.ones(len(triangles))
        count = int(np.clip(SAMPLES // max(len(triangles), 1), FEWEST, MOST))
        weights = _spread(count)
        drawn, opacity = np.empty(len(triangles), dtype=bool), np.empty(len(triangles))
        for first in range(0, len(triangles), max(AT_A_TIME // count, 1)):
            part = slice(first, first + max(AT_A_TIME // count, 1))
            rows = np.repeat(triangles[part], count, axis=0)
            alpha = self._alpha(one, Points(rows, np.tile(weights, (len(rows) // count, 1)))).reshape(-1, count)
            drawn[part] = (alpha >= (CLEAR if material.alpha_mode == "BLEND" else material.alpha_cutoff)).any(axis=1)
            opacity[part] = self._opaque(material, alpha).mean(axis=1)
        return drawn, opacity

    def _alpha(self, one: "DrawnPrimitive", points: Points) -> Float:
        primitive = self._entry(one)
        material = self._textured(primitive.get("material"))
        if material.texture is not None and (material.texture.pixels[..., 3] == 255).all():
            material = self.material(one)
        if material.texture is None and "COLOR_0" not in primitive["attributes"]:
            return np.full(len(points.rows), material.color[3])
        return base_color(self._document, material, primitive["attributes"], points)[:, 3]

    @staticmethod
    def _opaque(material: Material, alpha: Float) -> Bool:
        if material.alpha_mode == "OPAQUE":
            return np.ones(alpha.shape, dtype=bool)
        return alpha >= (OPAQUE if material.alpha_mode == "BLEND" else material.alpha_cutoff)

    def _entry(self, one: "DrawnPrimitive") -> dict[str, Any]:
        primitive: dict[str, Any] = self._document.entry("meshes", one.mesh)["primitives"][one.primitive]
        return primitive


def _spread(count: int) -> Float:
    """(``count``, 3) barycentric coordinates, evenly over a triangle: the R2 sequence (Roberts 2018), folded."""
    number = np.arange(count) + 0.5
    u, v = (number * 0.7548776662466927) % 1, (number * 0.5698402909980532) % 1
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    return np.column_stack([1 - u - v, u, v])
