"""Local Curvature Error (paper, supplement "Asset Utility")."""

import numpy as np
from numpy.typing import NDArray

from core.geometry.boxes import Boxes
from core.geometry.faces_near import near
from core.geometry.products import product
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.surface import Surface


def lce(
    original_index: SpatialIndex, watermarked: Surface, boxes: Boxes, relief: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Variance of the distance to the original over the vertices on the marks' caps: of each mark, mean over marks, and
    pooled, over the vertices of all marks together.

    Squared size-30 units; lower is better, 0 where letters follow the surface exactly. The paper pools, and all of its
    marks are equally high; where they are not, as ours, which are as high as their text is wide, the pooled variance is
    mostly that of their heights. A vertex is on a cap when it is in the box, extended by 1.5 reliefs to the front and
    back, more than half a relief off the original. Distances to faces that face away from the box do not count, such as
    those of a layer close above the letters whose back no viewer draws. None where no mark has any such vertex.
    ``relief`` is (B,), the height of each mark's letters.
    """
    reach = Boxes(boxes.center, boxes.axes, boxes.size + 3 * np.abs(relief)[:, None] * [0.0, 0.0, 1.0])
    heights = []
    for number, faces in enumerate(near(watermarked, reach)):
        vertices = np.unique(watermarked.faces[faces])
        local = reach.to_local(number, watermarked.positions[vertices])
        inside = vertices[(np.abs(local) <= reach.size[number] / 2).all(axis=1)]
        distance, face, _ = original_index.closest(watermarked.positions[inside])
        top = distance > abs(relief[number]) / 2
        height = distance[top]
        if relief[number] > 0:
            _look_down(
                original_index,
                watermarked.positions[inside[top]],
                face[top],
                reach.axes[number, 2],
                height,
                2 * relief[number],
            )
        if len(height):
            heights.append(height)
    if not heights:
        return None
    return float(np.mean([height.var() for height in heights])), float(np.concatenate(heights).var())


def _look_down(
    index: SpatialIndex,
    points: NDArray[np.float64],
    face: NDArray[np.int64],
    normal: NDArray[np.float64],
    distance: NDArray[np.float64],
    deepest: float,
) -> None:
    """Replaces, in place, the ``distance`` (N,) of ``points`` (N, 3) whose closest ``face`` (N,) faces against
    ``normal`` (3,) by that to the plane of the first face visible below them, if one is within ``deepest``."""
    away = np.flatnonzero(product(index.normals(face), normal[:, None])[:, 0] < 0)
    down, below = index.first_hit(points[away], np.broadcast_to(-normal, (len(away), 3)), Eye.ORIGIN)
    met = down <= deepest
    cosine = np.abs(product(index.normals(below[met]), normal[:, None])[:, 0])
    distance[away[met]] = down[met] * cosine
