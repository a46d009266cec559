"""The colour that is seen at points of a surface, read without a renderer."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.surface import Surface
from core.geometry.triangles import barycentric
from core.gltf.attributes import Points
from core.gltf.base_color import base_color as base_color_of
from core.gltf.base_color import emitted
from core.gltf.materials import Material
from core.gltf.scene import Scene


@dataclass(frozen=True, eq=False)
class Appearance:
    """Appearance of N points of a surface.

    Attributes:
        lit: (N, 3) linear RGB, 0 to 1, reflectance: the base colour; 0 where the material is unlit.
        glow: (N, 3) linear RGB, emitted: the base colour of unlit materials, the emission of others. May exceed 1.
        unlit: (N,) bool, points of unlit materials.
    """

    lit: Float
    glow: Float
    unlit: Bool

    def __getitem__(self, index: Int) -> "Appearance":
        return Appearance(self.lit[index], self.glow[index], self.unlit[index])

    @property
    def shown(self) -> Float:
        """(N, 3) linear RGB, 0 to 1, as a viewer shows it in full light."""
        return np.clip(self.lit + self.glow, 0, 1)


def base_color(scene: Scene, surface: Surface, points: Float, face: Int) -> Float:
    """(N, 3) linear RGB, 0 to 1, that a viewer shows in full light at points of a surface: base colour and emission.

    Arguments and errors are those of :func:`appearance`.
    """
    return appearance(scene, surface, points, face).shown


def appearance(scene: Scene, surface: Surface, points: Float, face: Int) -> Appearance:
    """The :class:`Appearance` of ``points`` (N, 3) on the faces ``face`` (N,) of a scene's surface.

    Base colour factor x texture (KHR_texture_transform, wrap modes, its own UV set) x COLOR_0, as the renderer shows
    it: textures that it cannot show, and those of primitives without their UV set, count as white. Alpha is ignored.

    Args:
        scene: the asset.
        surface: the scene's, in which faces may be wound the other way round.
        points: size-30 frame.
        face: the face that each point lies on, with an area.

    Raises:
        MeshmarkError: ``malformed_file`` for materials that are not well formed or refer to what does not exist, and
            for vertex attributes of too few components.
    """
    owner = surface.face_primitive[face]
    first = np.array([drawn.first_vertex for drawn in scene.primitives])
    corners = surface.faces[face]
    inside = Points(corners - first[owner, None], barycentric(points[:, None], surface.positions[corners])[:, 0])

    # Primitives that share attributes and material, such as instances, are read once.
    kinds: dict[tuple[Material, tuple[tuple[str, int], ...]], int] = {}
    kind_of = np.zeros(len(scene.primitives), dtype=np.int64)
    for number in np.unique(owner).tolist():
        primitive = scene.primitives[number].primitive
        key = primitive.material, tuple(sorted(primitive.attributes.items()))
        kind_of[number] = kinds.setdefault(key, len(kinds))

    read = scene.texture
    lit, glow, unlit = np.zeros((len(points), 3)), np.zeros((len(points), 3)), np.zeros(len(points), dtype=bool)
    for (material, attributes), kind in kinds.items():
        mine = np.flatnonzero(kind_of[owner] == kind)
        texture = None if material.texture is None else read(material.texture)
        color = base_color_of(scene.document, material, texture, dict(attributes), inside[mine])[:, :3]
        (glow if material.unlit else lit)[mine] = color
        if (emission := material.emission) is not None:
            texture = None if emission.texture is None else read(emission.texture)
            glow[mine] = emitted(scene.document, emission, texture, dict(attributes), inside[mine])
        unlit[mine] = material.unlit
    return Appearance(lit, glow, unlit)
