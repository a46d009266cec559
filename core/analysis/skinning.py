"""Articulation of skinned meshes: letters over several joints are deformed with the skin in every other pose."""

from dataclasses import dataclass

import numpy as np

from core.analysis.samples import SurfaceSamples
from core.arrays import Float, Int
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.geometry.triangles import barycentric
from core.gltf.primitives import DrawnPrimitive
from core.gltf.scene import Scene
from core.gltf.skin import read_influences


@dataclass(frozen=True, eq=False)
class SkinDeformation(SurfaceSamples):
    """Skin influences of samples of a surface.

    Attributes:
        joints: (N, K) int64, the nodes that move each sample; one may be named several times.
        weights: (N, K) float64, the weight of each of these; each row sums to 1.
    """

    joints: Int
    weights: Float

    def under(self, boxes: Boxes) -> Float:
        """(B,) articulation of the surface inside each of B boxes, 0 to 1: the Gini impurity of the mean weights. 0
        where all of the text follows one joint. Where two share it half and half it is 0.5, whether one moves the left
        half and the other the right (the text breaks) or both move all of it (blended rotations shrink)."""
        owner, which = self.pairs_in_boxes(boxes)
        box = np.repeat(owner, self.joints.shape[1])
        joint, weight = self.joints[which].ravel(), self.weights[which].ravel()
        nodes = int(self.joints.max()) + 1
        pair, same = np.unique(box * nodes + joint, return_inverse=True)
        count = np.bincount(owner, minlength=len(boxes))
        share = np.bincount(same, weights=weight) / count[pair // nodes]
        squared = np.bincount(pair // nodes, weights=share**2, minlength=len(boxes))
        return np.asarray(np.clip(1 - squared, 0, 1))


def skin_deformation(scene: Scene, surface: Surface, points: Float, face: Int) -> SkinDeformation | None:
    """The :class:`SkinDeformation` at ``points`` (N, 3) of a scene's ``surface``, on its faces ``face`` (N,), size-30
    units.

    Primitives without a skin follow their node. ``None`` where nothing of the asset is skinned.
    """
    skinned = [_influences(scene, drawn) for drawn in scene.primitives]
    if not any(found is not None for found in skinned):
        return None
    owner = surface.face_primitive[face]
    corners = surface.faces[face]
    share = barycentric(points[:, None], surface.positions[corners])[:, 0]
    most = 3 * max(found[0].shape[1] for found in skinned if found is not None)
    moved, weights = np.zeros((len(points), most), dtype=np.int64), np.zeros((len(points), most))
    for number in np.unique(owner).tolist():
        drawn, found = scene.primitives[number], skinned[number]
        mine = np.flatnonzero(owner == number)
        if found is None:
            moved[mine, 0], weights[mine, 0] = drawn.node.index, 1.0
            continue
        nodes, strength = found
        rows = corners[mine] - drawn.first_vertex
        columns = 3 * nodes.shape[1]
        moved[mine, :columns] = nodes[rows].reshape(len(mine), columns)
        weights[mine, :columns] = (share[mine][:, :, None] * strength[rows]).reshape(len(mine), columns)
    return SkinDeformation(points, surface.normals[face], moved, weights)


def _influences(scene: Scene, drawn: DrawnPrimitive) -> tuple[Int, Float] | None:
    """The nodes (V, K) that move each vertex of a primitive, and by how much (V, K); None where it has no skin."""
    if drawn.skin is None:
        return None
    numbers, strength = read_influences(scene.document, drawn.primitive.attributes)
    return drawn.skin.joints[numbers], strength
