"""Articulation of skinned meshes: letters over several joints are deformed with the skin in every other pose."""

from dataclasses import dataclass

import numpy as np

from core.analysis.motion import turns
from core.analysis.samples import Pairs, SurfaceSamples
from core.arrays import Float, Int
from core.geometry.products import product
from core.geometry.surface import Surface
from core.geometry.triangles import barycentric
from core.gltf.primitives import DrawnPrimitive
from core.gltf.scene import Scene
from core.gltf.skin import read_influences

TORN = np.radians(90.0)  # turn of two joints against each other from which on text across them is torn
UNKNOWN = 0.5  # of that, joints of an asset without animations: some are elbows, more are the spine of a body
STILL = 0.2  # of that, joints that no animation of the asset turns against each other: others may


@dataclass(frozen=True, eq=False)
class SkinDeformation(SurfaceSamples):
    """Skin influences of samples of a surface.

    Attributes:
        joints: (N, K) int64, the nodes that move each sample; one may be named several times.
        weights: (N, K) float64, the weight of each of these; each row sums to 1.
        nodes: (M,) int64 in ascending order, all of these joints.
        torn: (M, M) how much text is torn that two of the ``nodes`` move, 0 to 1; 0 for one and the same.
    """

    joints: Int
    weights: Float
    nodes: Int
    torn: Float

    def under(self, boxes: Pairs) -> Float:
        """(B,) articulation of the surface inside each of B boxes, 0 to 1: how much its text is torn on average over
        pairs of joints, drawn by the mean weights (Rao 1982; the Gini impurity where any two joints tear it). 0 where
        all of the text follows one joint. Where two share it half and half it is half of what these two tear it,
        whether one moves the left half and the other the right (the text breaks) or both move all of it (blended
        rotations shrink)."""
        cell = boxes.box[:, None] * len(self.nodes) + np.searchsorted(self.nodes, self.joints[boxes.sample])
        total = np.bincount(cell.ravel(), self.weights[boxes.sample].ravel(), boxes.boxes * len(self.nodes))
        share = total.reshape(boxes.boxes, len(self.nodes)) / boxes.samples[:, None]
        return np.asarray(np.clip((product(share, self.torn) * share).sum(axis=1), 0, 1))


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
    nodes = np.unique(moved)
    return SkinDeformation(points, surface.normals[face], moved, weights, nodes, _torn(turns(scene, nodes), len(nodes)))


def _torn(turned: Float | None, number: int) -> Float:
    """(M, M) see :class:`SkinDeformation`, of a ``number`` of nodes that are ``turned`` (M, M), radians, against each
    other; None where that is not known."""
    torn = np.full((number, number), UNKNOWN) if turned is None else np.clip(turned / TORN, STILL, 1)
    np.fill_diagonal(torn, 0.0)
    return torn


def _influences(scene: Scene, drawn: DrawnPrimitive) -> tuple[Int, Float] | None:
    """The nodes (V, K) that move each vertex of a primitive, and by how much (V, K); None where it has no skin."""
    if drawn.skin is None:
        return None
    numbers, strength = read_influences(scene.document, drawn.primitive.attributes)
    return drawn.skin.joints[numbers], strength
