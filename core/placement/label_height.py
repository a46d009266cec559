"""Height of a label's letters in pictures, where a rule asks for one."""

import numpy as np

from core.arrays import Bool, Float
from core.geometry.boxes import Boxes
from core.geometry.directions import EYE_DISTANCE, field_of_view, view_directions
from core.notices import Notice, NoticeCode


def picture_side(radius: float) -> float:
    """Size-30 units that a picture shows from side to side at the middle of an asset of a ``radius``."""
    return float(2 * EYE_DISTANCE * np.tan(field_of_view(radius) / 2))


def label_heights(boxes: Boxes, height: Float, visible: Bool, radius: float) -> Float:
    """(24,) height of the highest letters that each of the paper's views shows, over the side of its picture, which is
    square and shows the whole asset; 0 where it shows none.

    Args:
        boxes: of the B marks.
        height: (B,) of their letters, size-30 units; it is measured along the letters, wherever they are turned in the
            picture.
        visible: (B, 24) the views that show each mark.
        radius: of the asset about the middle of its frame.
    """
    directions, ups = view_directions()
    right = np.cross(ups, directions)
    half = height[:, None] / 2 * boxes.axes[:, 1]
    ends = np.stack([boxes.center - half, boxes.center + half])
    depth = EYE_DISTANCE - ends @ directions.T
    across, along = ends @ right.T / depth, ends @ ups.T / depth
    length = np.hypot(across[1] - across[0], along[1] - along[0]) / (2 * np.tan(field_of_view(radius) / 2))
    return np.asarray(np.where(visible, length, 0.0).max(axis=0, initial=0.0))


def too_small(heights: Float, rule: float) -> list[Notice]:
    """The notice that some of the views, in which letters are so high, show none as high as the ``rule`` asks for."""
    reached = int((heights >= rule).sum())
    if reached == len(heights):
        return []
    return [
        Notice(
            NoticeCode.LABEL_TOO_SMALL,
            f"The letters of the label should be {rule:.0%} of the picture's shorter side high. They are in {reached} "
            f"of {len(heights)} views from all sides; at their largest they have {heights.max():.1%}.",
            "Nothing larger has room on the other sides: show one of those views first, or ask for a shorter `text`.",
        )
    ]
