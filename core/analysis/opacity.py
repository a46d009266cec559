"""Opacity at points of faces that are opaque in part: a texture with holes leaves places for text between them."""

from collections.abc import Callable

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.surface import Surface
from core.geometry.triangles import barycentric
from core.gltf.attributes import Points
from core.gltf.scene import Scene
from core.gltf.viewer import Look

Opacity = Callable[[Float, Int], Bool]


def opacity(scene: Scene, surface: Surface, usable: Bool) -> Opacity | None:
    """A test of points (N, 3) on faces (N,) of a scene's surface for opacity; None where all ``usable`` faces are
    opaque everywhere.

    Args:
        scene: the asset.
        surface: the scene's, in which faces may be wound the other way round.
        usable: (F,) the faces to be tested.
    """
    mixed = usable & (scene.viewed.opacity < 1)
    if not mixed.any():
        return None
    look = Look(scene.document)

    def opaque(points: Float, face: Int) -> Bool:
        found = np.ones(len(points), dtype=bool)
        tested = np.flatnonzero(mixed[face])
        owner = surface.face_primitive[face[tested]]
        for number in np.unique(owner).tolist():
            mine, drawn = tested[owner == number], scene.primitives[number]
            corners = surface.faces[face[mine]]
            inside = barycentric(points[mine, None], surface.positions[corners])[:, 0]
            found[mine] = look.opaque_at(drawn.primitive, Points(corners - drawn.first_vertex, inside))
        return found

    return opaque
