"""Visibility of a scene's faces in a viewer (glTF 2.0): drawn or not, one-sided or not, and their opacity.

This is the one source of visibility: for the frame of the surface, the analysis, the rays of placement, embossing and
metrics, and the check of the written file.

- A node that KHR_node_visibility hides, or one below it, draws nothing.
- A material that is not ``doubleSided`` shows the front of its faces only (3.9.5): counter-clockwise, and clockwise
  where the node's determinant is negative (3.7.4). A :class:`~core.geometry.surface.Surface` has its faces wound so.
- Where ``alphaMode`` is not OPAQUE (3.9.4), effective alpha, factor x texture x COLOR_0, decides: exporters write BLEND
  on opaque bodies. Faces that are clear everywhere are not drawn.
- A node that flattens its mesh to a line or a point, as a scale of 0 does, draws nothing.

Shading is outside this module: see :mod:`core.gltf.materials`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.products import cross
from core.gltf.attributes import Points
from core.gltf.base_color import base_color
from core.gltf.document import Document
from core.gltf.materials import Material
from core.gltf.primitives import DrawnPrimitive, Primitive
from core.gltf.textures import texture_reader

if TYPE_CHECKING:
    from core.geometry.surface import Surface


# Alpha from which on a blended surface occludes, and from which on it is visible.
OPAQUE, CLEAR = 0.9, 0.02
# Samples of a primitive's alpha: in all, at least and at most on each triangle, and at a time.
SAMPLES, FEWEST, MOST, AT_A_TIME = 100_000, 3, 200, 200_000
NEEDLE = 1e-7  # height over length; a triangle of less is a line, whose area is rounding errors


@dataclass(frozen=True, eq=False)
class Viewed:
    """Visibility of F faces in a viewer.

    Attributes:
        drawn: (F,) bool, visible faces. Where the file hides all of them, all are.
        one_sided: (F,) bool, faces that are drawn from their front only.
        opacity: (F,) share of each face's area that occludes, 0 to 1.
    """

    drawn: Bool
    one_sided: Bool
    opacity: Float


def viewed(document: Document, surface: "Surface", primitives: Sequence[DrawnPrimitive]) -> Viewed:
    """Visibility of the faces of a scene's ``surface``, those of one of ``primitives`` after the other.

    Raises:
        MeshmarkError: ``malformed_file`` for textures that do not exist.
    """
    look = Look(document)
    parts = [(look.drawn(one, one.triangles), one) for one in primitives]
    drawn = np.concatenate([seen for (seen, _), _ in parts])
    for number in [number for number, one in enumerate(primitives) if not one.invertible]:
        mine = np.flatnonzero(surface.face_primitive == number)
        drawn[mine] &= has_area(surface.positions[surface.faces[mine]]).any()
    # Only faces without area reach beyond the frame.
    if np.abs(surface.positions).max() > surface.reach:
        drawn &= (np.abs(surface.positions[surface.faces]) <= surface.reach).all(axis=(1, 2))
    if not drawn.any():
        drawn[:] = True
    one_sided = np.array([not one.primitive.material.double_sided for one in primitives])
    return Viewed(drawn, one_sided[surface.face_primitive], np.concatenate([opacity for (_, opacity), _ in parts]))


def drawn_part(surface: "Surface", drawn: Bool) -> "Surface":
    """The surface with the faces that are not ``drawn`` (F,) collapsed to their first corner: no face changes its
    number, but samples, areas and rays find only drawn ones."""
    if drawn.all():
        return surface
    return replace(surface, faces=np.where(drawn[:, None], surface.faces, surface.faces[:, :1]))


@np.errstate(over="ignore", invalid="ignore")  # an overflowing triangle is not drawn
def has_area(corners: Float) -> Bool:
    """(F,) those of the triangles ``corners`` (F, 3, 3) that are not points or lines."""
    a, b, c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1], corners[:, 0] - corners[:, 2]
    longest = np.maximum(np.maximum((a * a).sum(axis=1), (b * b).sum(axis=1)), (c * c).sum(axis=1))
    return np.asarray(np.linalg.norm(cross(a, b), axis=1) > NEEDLE * longest)


class Look:
    """Alpha of a document's primitives; that of a whole one, and textures, are read once, at their first use."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._texture = texture_reader(document)
        self._whole: dict[Primitive, tuple[Bool, Float]] = {}  # nodes may share them

    def drawn(self, one: DrawnPrimitive, triangles: Int) -> tuple[Bool, Float]:
        """Those (T,) of some ``triangles`` (T, 3: accessor rows) of a primitive that are drawn, and the opacity of each
        (T,): see :class:`Viewed`. Collapsed ones count as drawn."""
        if one.node.hidden:
            return np.zeros(len(triangles), dtype=bool), np.ones(len(triangles))
        if len(triangles) < len(one.triangles):
            return self._by_alpha(one.primitive, triangles)
        if one.primitive not in self._whole:
            self._whole[one.primitive] = self._by_alpha(one.primitive, triangles)
        return self._whole[one.primitive]

    def opaque_at(self, one: Primitive, points: Points) -> Bool:
        """(C,) those of ``points`` at which a primitive occludes."""
        return self._opaque(one.material, self._alpha(one, points))

    def _by_alpha(self, one: Primitive, triangles: Int) -> tuple[Bool, Float]:
        material = one.material
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

    def _alpha(self, one: Primitive, points: Points) -> Float:
        texture = None if one.material.texture is None else self._texture(one.material.texture)
        if texture is not None and (texture.pixels[..., 3] == 255).all():
            texture = None
        if texture is None and "COLOR_0" not in one.attributes:
            return np.full(len(points.rows), one.material.color[3])
        return base_color(self._document, one.material, texture, one.attributes, points)[:, 3]

    @staticmethod
    def _opaque(material: Material, alpha: Float) -> Bool:
        if material.alpha_mode == "OPAQUE":
            return np.ones(alpha.shape, dtype=bool)
        return alpha >= (OPAQUE if material.alpha_mode == "BLEND" else material.alpha_cutoff)


def _spread(count: int) -> Float:
    """(``count``, 3) barycentric coordinates, evenly over a triangle: the R2 sequence (Roberts 2018), folded."""
    number = np.arange(count) + 0.5
    u, v = (number * 0.7548776662466927) % 1, (number * 0.5698402909980532) % 1
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    return np.column_stack([1 - u - v, u, v])
