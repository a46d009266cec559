"""Regions that a request keeps free of watermarks or prefers: nodes, materials and boxes as faces and boxes."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np

from core.arrays import Bool, Float, Int
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.overlap import boxes_meet, triangles_meet
from core.geometry.surface import Surface
from core.gltf.document import Document
from core.gltf.primitives import DrawnPrimitive
from core.gltf.scene import Scene
from core.gltf.skin import read_influences
from core.named_regions import MAX_NAME_LENGTH, Box, BoxRegion, MaterialRegion, NodeRegion
from core.parameters import Parameters

LISTED = 10  # names in an error
FOLLOWS = 0.5  # sum of skin weights; with at least this a corner belongs to the joints that move it
FAR = 1e6  # size-30 units; larger coordinates of a box are clamped to this, the surface ends at 15


@dataclass(frozen=True, eq=False)
class Regions:
    """The regions of a request on one surface, size-30 frame.

    A face may be far larger than a region's box, so boxes are kept beside the masks: a face that is only partly in a
    box stays allowed, and what is placed on it is tested against the box itself.

    Attributes:
        allowed: (F,) faces that are not kept out: neither by name nor by lying wholly in one of ``boxes_out``.
        preferred: (F,) allowed faces that are preferred by name or lie wholly in one of ``boxes_in``.
        boxes_out: (K, 2, 3) lowest and highest corner of the boxes to keep out of.
        boxes_in: (L, 2, 3) those of the preferred boxes.
    """

    allowed: Bool
    preferred: Bool
    boxes_out: Float
    boxes_in: Float

    def within(self, usable: Bool) -> Bool:
        """(F,) the ``usable`` faces that are allowed.

        Raises:
            MeshmarkError: ``no_placement`` when there were usable faces and ``keep_out`` leaves none of them.
        """
        left = usable & self.allowed
        if usable.any() and not left.any():
            raise MeshmarkError(
                ErrorCode.NO_PLACEMENT,
                f"`keep_out` leaves no place for a watermark: it takes all {usable.sum()} faces that could carry one.",
                "Keep less of the asset out.",
            )
        return left

    def touches(self, boxes: Boxes, margin: float = 0.0) -> Bool:
        """(B,) oriented boxes that intersect one of ``boxes_out``, or come as close as ``margin`` to it."""
        grown = self.boxes_out + margin * np.array([[-1.0], [1.0]])
        return np.asarray(boxes_meet(boxes, grown).any(axis=1))

    def preference(self, points: Float, face: Int) -> Float:
        """(B,) share of (B, N, 3) ``points`` on the faces (B, N) that are preferred; -1 as a face is none."""
        inside = self.preferred[face]
        for low, high in self.boxes_in:
            inside |= ((points >= low) & (points <= high)).all(axis=2)
        return np.asarray((inside & (face >= 0)).mean(axis=1))


def regions(scene: Scene, surface: Surface, parameters: Parameters) -> Regions:
    """Resolves ``keep_out`` and ``prefer`` on ``surface``, which has the faces of ``scene.surface`` in their order.

    A node's name means all nodes of that name and everything below them; a node without a name goes by that of its
    mesh, as in viewers. A triangle of a skin belongs to a joint, too, if a corner follows that joint and those
    below it by at least half its weight. ``keep_out`` wins over ``prefer``.

    Raises:
        MeshmarkError: ``unknown_region`` for a name that no triangle goes by, or a box that touches none.
    """
    masks, boxes = {}, {}
    for field, asked in (("keep_out", parameters.keep_out), ("prefer", parameters.prefer)):
        mask, corners = np.zeros(len(surface.faces), dtype=bool), np.zeros((0, 2, 3))
        for number, region in enumerate(asked):
            where = f"{field}[{number}]"
            match region:
                case NodeRegion(node=name):
                    found = _node_faces(scene, name)
                    if not found.any():
                        raise _unknown(where, "node", name, _drawing_names(scene))
                    mask |= found
                case MaterialRegion(material=name):
                    found = _material_faces(scene, name)
                    if not found.any():
                        raise _unknown(where, "material", name, _material_names(scene))
                    mask |= found
                case BoxRegion(box=box):
                    low, high = _corners(surface, box)
                    inside = np.all((surface.positions >= low) & (surface.positions <= high), axis=1)[surface.faces]
                    # The exact test is needed only where no corner is in the box.
                    if not inside.any() and not triangles_meet(surface.positions[surface.faces], low, high).any():
                        raise _untouched(surface, box, where)
                    mask |= inside.all(axis=1)
                    corners = np.concatenate([corners, [[low, high]]])
        masks[field], boxes[field] = mask, corners
    allowed = ~masks["keep_out"]
    return Regions(allowed, masks["prefer"] & allowed, boxes["keep_out"], boxes["prefer"])


def _node_faces(scene: Scene, name: str) -> Bool:
    """(F,) faces that nodes of this name draw, or nodes below them; of a skin, those that such nodes move."""
    inside: set[int] = set()
    for node in scene.nodes:  # parents come before their children
        if node.label == name:
            inside.add(node.index)
        if node.index in inside:
            inside.update(node.children)
    members = np.array(sorted(inside), dtype=np.int64)
    drawn: Bool = np.array([one.node.index in inside for one in scene.primitives])
    mask: Bool = drawn[scene.surface.face_primitive]
    for number, one in enumerate(scene.primitives):
        if one.skin is None or drawn[number]:
            continue
        joints = np.flatnonzero(np.isin(one.skin.joints, members))
        if len(joints):
            mask[scene.surface.face_primitive == number] = _followers(scene.document, one, joints)
    return mask


def _followers(document: Document, one: DrawnPrimitive, joints: Int) -> Bool:
    """(T,) triangles with a corner that follows these ``joints`` of the skin by at least half its weight."""
    followed, weights = read_influences(document, one.primitive.attributes)
    share = (weights * np.isin(followed, joints)).sum(axis=1)
    return np.asarray((share[one.triangles] >= FOLLOWS).any(axis=1))


def _leaders(document: Document, one: DrawnPrimitive) -> list[int]:
    """The nodes that some corner of a skinned primitive follows by at least half its weight."""
    if one.skin is None:
        return []
    followed, weights = read_influences(document, one.primitive.attributes)
    used = np.unique(one.triangles)
    nodes: list[int] = one.skin.joints[np.unique(followed[used][weights[used] >= FOLLOWS])].tolist()
    return nodes


def _drawing_names(scene: Scene) -> Iterable[str]:
    """Names of all nodes that draw or move a triangle, or have one below them that does."""
    drawing = {one.node.index for one in scene.primitives}
    for one in scene.primitives:
        drawing.update(_leaders(scene.document, one))
    for node in reversed(scene.nodes):
        if not drawing.isdisjoint(node.children):
            drawing.add(node.index)
    return (node.label for node in scene.nodes if node.index in drawing)


def _material_names(scene: Scene) -> Iterable[str]:
    return (one.primitive.material.name for one in scene.primitives)


def _material_faces(scene: Scene, name: str) -> Bool:
    """(F,) faces of the materials of this name."""
    return np.array([found == name for found in _material_names(scene)])[scene.surface.face_primitive]


def _unknown(where: str, kind: str, name: str, names: Iterable[str]) -> MeshmarkError:
    # First those that the name may be a misspelling of, then all in file order.
    usable = list(dict.fromkeys(known for known in names if known and len(known) <= MAX_NAME_LENGTH))
    listed = list(dict.fromkeys(get_close_matches(name, usable, LISTED) + usable))[:LISTED]
    more = f" and {len(usable) - LISTED} more" if len(usable) > LISTED else ""
    return MeshmarkError(
        ErrorCode.UNKNOWN_REGION,
        f"`{where}`: no triangle of this asset belongs to a {kind} named {_quoted(name)}.",
        f"Its {kind}s are {', '.join(map(_quoted, listed))}{more}."
        if listed
        else f"No {kind} of this asset has a name; give a box instead.",
    )


def _quoted(name: str) -> str:
    return json.dumps(name, ensure_ascii=False)  # a name may hold quotes and control characters


def _corners(surface: Surface, box: Box) -> Float:
    """(2, 3) lowest and highest corner of a box in the size-30 frame."""
    with np.errstate(over="ignore"):
        corners = (np.array([box.min, box.max]) - surface.offset) * surface.scale
    return np.clip(corners, -FAR, FAR)


def _untouched(surface: Surface, box: Box, where: str) -> MeshmarkError:
    used = surface.positions[np.unique(surface.faces)]
    low, high = surface.to_world(np.stack([used.min(axis=0), used.max(axis=0)]))
    return MeshmarkError(
        ErrorCode.UNKNOWN_REGION,
        f"`{where}`: no triangle of this asset reaches into the box from {_point(box.min)} to {_point(box.max)}.",
        f"The asset lies between {_point(low)} and {_point(high)}; a box is given in these coordinates.",
    )


def _point(point: Iterable[float]) -> str:
    return f"({', '.join(f'{value:.6g}' for value in point)})"
