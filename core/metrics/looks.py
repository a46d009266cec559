"""The places at which the letters in a picture are looked for first."""

import numpy as np

from core.arrays import Bool, Float
from core.geometry.boxes import Boxes
from core.geometry.directions import EYE_DISTANCE, field_of_view, to_cameras, view_directions
from core.rendering.renderer import Frame


def first_looks(boxes: Boxes, seen: Bool, frame: Frame) -> tuple[Float, Float]:
    """The highest letters in each of the paper's views: (24, 2) their middle, to the right and down, in shares of the
    picture's side, nan where no letters are seen; and (24, 2) the way in which they run.

    Args:
        boxes: of the B marks.
        seen: (B, 24) the views that show each mark.
        frame: of the pictures.
    """
    directions, ups = view_directions()
    middle = boxes.center - np.array(frame.center)
    toward = to_cameras(np.repeat(middle[:, None], len(directions), axis=1).swapaxes(0, 1), directions)
    distance = np.linalg.norm(toward, axis=2)
    facing = np.einsum("vbi,bi->vb", toward, boxes.axes[:, 2]) / distance
    height = np.where(seen.T, boxes.size[:, 1] * facing / distance, 0.0)
    if not height.size:
        return np.full((len(directions), 2), np.nan), np.zeros((len(directions), 2))
    views, best = np.arange(len(directions)), height.argmax(axis=1)
    axes = np.stack([np.cross(ups, directions), -ups], axis=1)
    slope = 2 * np.tan(field_of_view(frame.radius) / 2)

    def place(points: Float) -> Float:
        depth = EYE_DISTANCE - np.einsum("vi,vi->v", points, directions)
        return np.asarray(0.5 + np.einsum("vki,vi->vk", axes, points) / (slope * depth)[:, None])

    at, after = place(middle[best]), place(middle[best] + boxes.axes[best, 0] * boxes.size[best, :1] / 2)
    return np.where(height[views, best, None] > 0, at, np.nan), after - at
