"""The paper's filters, in its order: from optimised boxes to those that get a watermark (supplement, "Filtering")."""

import numpy as np

from core.arrays import Bool, Int
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.directions import view_directions
from core.geometry.sampling import sample
from core.geometry.surface import MODEL_SIZE
from core.lab.baselines.strategy import Prepared
from core.metrics.ray_origins import top_face
from core.metrics.se import VOTE
from core.placement.filters import occluded, overlapping, roughness, smooth
from core.placement.objective import FACING_VIEW

OCTANTS = 8
ROUGHNESS_DENSITY = 60  # area samples in one box
BEYOND = 2 * MODEL_SIZE  # size-30 units; longer than any ray inside the frame


def paper_filters(prepared: Prepared, boxes: Boxes, aligned: Bool, count: int, rng: np.random.Generator) -> Boxes:
    """At most ``count`` of ``boxes``, by the paper's rules.

    Alignment, roughness, overlap, occlusion, saliency, then one box an octant and one for each of the 24 views that
    none faces. In the paper the last two rules decide the number of boxes; here ``count`` truncates their list, and
    where it is larger, the box furthest from all chosen ones is added as long as there is one.

    Two tests are stricter than the paper's, which use vertices and so have no effect on a coarse mesh: roughness is
    taken over area samples, and boxes overlap where their volumes do.

    Args:
        prepared: the asset.
        boxes: B boxes of one size.
        aligned: (B,) boxes that pass the alignment filter.
        count: number to choose, at most.
        rng: the source of every draw.

    Raises:
        MeshmarkError: ``no_placement`` naming the filter that dropped the last box.
    """
    boxes = _some(boxes[aligned], "the surface bends away from them or ends under them")
    points, face = sample(prepared.surface, _samples(prepared, boxes), rng)
    rough = roughness(boxes, points, prepared.surface.normals[face])
    boxes = _some(boxes[smooth(rough)], "the surface under them is too rough")
    boxes = boxes[apart(boxes, rng)]
    blocked = occluded(boxes, top_face(boxes), prepared.index, BEYOND)
    boxes = _some(boxes[~blocked], "another part is in front of them")
    _, salient = prepared.saliency.under(prepared.saliency.pairs_in_boxes(boxes))
    boxes = _some(boxes[salient <= VOTE], "they lie on salient regions")
    return boxes[choose(boxes, count, rng)]


def apart(boxes: Boxes, rng: np.random.Generator) -> Int:
    """Indices of boxes that do not overlap: in random order, each that is clear of all before it."""
    free = np.ones(len(boxes), dtype=bool)
    kept = []
    for one in rng.permutation(len(boxes)).tolist():
        if free[one]:
            kept.append(one)
            free &= ~overlapping(boxes, one)
    return np.asarray(kept, dtype=np.int64)


def choose(boxes: Boxes, count: int, rng: np.random.Generator) -> Int:
    """Indices of at most ``count`` boxes: the octant rule, the view rule, then by distance; see ``paper_filters``.

    The first octant takes a box at random, each further one that which is furthest from those already chosen. A view
    that no chosen box faces within 45 degrees gets the box that faces it most squarely.
    """
    octant = (boxes.center > 0) @ np.array([1, 2, 4])
    chosen: list[int] = []
    for number in range(OCTANTS):
        inside = np.flatnonzero(octant == number)
        if len(inside):
            chosen.append(_furthest(boxes, inside, chosen) if chosen else int(rng.choice(inside)))
    cosine = boxes.axes[:, 2] @ view_directions()[0].T
    for view in cosine.T:
        if view[chosen].max() < FACING_VIEW <= view.max():
            chosen.append(int(view.argmax()))
    while len(chosen) < min(count, len(boxes)):
        chosen.append(_furthest(boxes, np.setdiff1d(np.arange(len(boxes)), chosen), chosen))
    return np.asarray(chosen[:count], dtype=np.int64)


def _furthest(boxes: Boxes, among: Int, chosen: list[int]) -> int:
    distance = np.linalg.norm(boxes.center[among][:, None] - boxes.center[chosen][None], axis=2)
    return int(among[distance.min(axis=1).argmax()])


def _samples(prepared: Prepared, boxes: Boxes) -> int:
    width, height, _ = boxes.size[0]
    return int(np.clip(ROUGHNESS_DENSITY * prepared.surface.areas.sum() / (width * height), 1000, 200_000))


def _some(boxes: Boxes, reason: str) -> Boxes:
    if len(boxes) == 0:
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"The paper's filters leave no place for the text on this asset: of the last boxes, {reason}.",
            "Ask for a smaller `size`.",
        )
    return boxes
