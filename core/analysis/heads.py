"""Heads of figures by the bones, or the parts, that make them up: by their names, or by where they are."""

import re
from collections import Counter

import numpy as np

from core.analysis.skinning import SkinDeformation
from core.analysis.symmetry import MirrorPlane
from core.arrays import Bool, Int
from core.gltf.hierarchy import Node, world_matrices
from core.gltf.scene import Scene

FOLLOWS = 0.5  # sum of skin weights; a sample with at least this follows the bones
MIDDLE = 1.0  # size-30 units from the mirror plane, at most, to a bone of the head
MOST = 0.5  # share of the samples on heads, at most: more is a bust, of which the head is the whole
# Words of bones' names in Mixamo, Blender, Rigify, VRM, Unreal, 3ds Max and Japanese rigs; a neck only without a head.
HEADS = re.compile(
    r"(?:left|right)?(?:head|skull|face|forehead|eye|eyes|eyeball|eyelid|brow|eyebrow|nose|cheek|jaw|mouth|lip|lips|"
    r"chin|teeth|tongue|ear|ears|muzzle|snout|beak)(?:left|right|top|nub|end)?|頭|顔|左?右?目|両目|顎"
)
NECKS = re.compile(r"neck|首")
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_A-Za-z]+")


def on_head(scene: Scene, skin: SkinDeformation | None, face: Int, plane: MirrorPlane | None) -> Bool | None:
    """(N,) samples of a scene's surface that lie on a head, from its bones and nodes.

    A sample follows the bones of a head, or those below them, by at least half its weight; without a skin it belongs to
    the node that draws it. What is not skinned but hangs from a bone, a hat or a helmet, is no head unless its own
    name says so. Where no bone's name is that of a head or neck, the head is moved by the highest chain of bones that
    ends in the middle: hands and feet come in pairs, and a tail ends lower. ``None`` where there is no head, and where
    heads would be most of the asset.

    Args:
        scene: the asset.
        skin: at the samples; None where nothing is skinned.
        face: (N,) the face of the scene's surface that each sample lies on.
        plane: of symmetry; None where the asset has none.
    """
    joints = {int(joint) for drawn in scene.primitives if drawn.skin is not None for joint in drawn.skin.joints}
    nodes = _named(scene.nodes, HEADS, joints)
    if not nodes & joints:
        nodes |= _named(scene.nodes, NECKS, joints) & joints
    if not nodes and joints and plane is not None:
        nodes = _highest(scene, joints, plane)
    if not nodes:
        return None
    members = np.array(sorted(nodes), dtype=np.int64)
    if skin is None:
        drawing = np.array([drawn.node.index for drawn in scene.primitives], dtype=np.int64)
        inside = np.isin(drawing[scene.surface.face_primitive[face]], members)
    else:
        inside = (skin.weights * np.isin(skin.joints, members)).sum(axis=1) >= FOLLOWS
    return inside if 0 < inside.mean() <= MOST else None


def _named(nodes: tuple[Node, ...], pattern: re.Pattern[str], joints: set[int]) -> set[int]:
    """The nodes with a word of ``pattern`` in their names, and those below them: bones below bones, others below
    others."""
    found: set[int] = set()
    for node in nodes:  # parents come before their children
        if node.index in found or any(pattern.fullmatch(word) for word in words(node.label)):
            found.add(node.index)
            found.update(child for child in node.children if (child in joints) == (node.index in joints))
    return found


def _highest(scene: Scene, joints: set[int], plane: MirrorPlane) -> set[int]:
    """The bones of the highest chain that ends near the ``plane``; empty where none ends above the bones' middle."""
    parent = {child: node.index for node in scene.nodes for child in node.children if {child, node.index} <= joints}
    below = Counter(parent.values())
    bones = sorted(joints)
    where = (world_matrices(scene.document)[bones, :3, 3] - scene.surface.offset) * scene.surface.scale
    height = dict(zip(bones, where[:, 1].tolist(), strict=True))
    middle = dict(zip(bones, (np.abs(plane.side(where)) <= MIDDLE).tolist(), strict=True))
    ends = [bone for bone in bones if not below[bone] and middle[bone] and height[bone] > float(where[:, 1].mean())]
    if not ends:
        return set()
    chain = [max(ends, key=lambda bone: height[bone])]
    while chain[-1] in parent and below[parent[chain[-1]]] == 1:
        chain.append(parent[chain[-1]])
    return set(chain)


def words(name: str) -> list[str]:
    """The words of a bone's name in lower case: "mixamorig:HeadTop_End" is mixamorig, head, top and end."""
    return [word.lower() for word in _WORDS.findall(name)]
