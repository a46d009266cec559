"""Primitives that are no place for a watermark: what is seen through, cut out, hidden or flattened."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.asset.flatten import Scene
from core.asset.hierarchy import hidden_nodes

Bool = NDArray[np.bool_]

SEE_THROUGH_MODES = ("MASK", "BLEND")


@dataclass(frozen=True, eq=False)
class Editable:
    """(F,) masks over the faces of a scene's surface.

    Attributes:
        solid: opaque, shown, and with a transform that can be inverted: the places to use.
        possible: ``solid`` and the see-through ones: what can be used where nothing solid has room.
        shown: faces of nodes that are not hidden. Where all are hidden, all count as shown.
    """

    solid: Bool
    possible: Bool
    shown: Bool


def editable(scene: Scene) -> Editable:
    """Which faces may carry a watermark.

    Not those of primitives whose material is masked or blended (glTF 2.0, 3.9.4), of nodes that KHR_node_visibility
    hides, or of nodes whose transform flattens them. Glass (KHR_materials_transmission) may: its surface is all there,
    and the walls of letters refract.
    """
    hidden = hidden_nodes(scene.document)
    shown = np.array([drawn.node not in hidden for drawn in scene.primitives])
    if not shown.any():
        shown[:] = True
    invertible = np.array([drawn.invertible for drawn in scene.primitives])
    see_through = np.array([_is_see_through(scene, number) for number in range(len(scene.primitives))])
    owner = scene.surface.face_primitive
    possible = invertible & shown
    return Editable((possible & ~see_through)[owner], possible[owner], shown[owner])


def _is_see_through(scene: Scene, number: int) -> bool:
    drawn, document = scene.primitives[number], scene.document
    primitive = document.entry("meshes", drawn.mesh)["primitives"][drawn.primitive]
    if "material" not in primitive:
        return False
    material = document.entry("materials", primitive["material"])
    return material.get("alphaMode") in SEE_THROUGH_MODES
