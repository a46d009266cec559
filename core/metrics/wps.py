"""Watermark Placement Score, as the paper computes it (supplement "Watermark Quality")."""

import numpy as np

from core.arrays import Float
from core.geometry.boxes import Boxes
from core.geometry.faces_near import near
from core.geometry.surface import Surface


def wps(original: Surface, boxes: Boxes) -> Float:
    """(B,) projected area of the original's faces wholly inside each box over the box's front area, 0 to 1.

    Higher is better. Faces with one vertex outside do not count, hence coarse meshes score low however well the
    box sits: see ``wps_area``. Areas are projected onto the box's normal; faces that face away from it count
    nothing. The paper's Eq. 1 has ``max{., 1}``, which must mean ``min``.
    """
    score = np.zeros(len(boxes))
    for number, faces in enumerate(near(original, boxes)):
        local = boxes.to_local(number, original.positions[original.faces[faces]])
        whole = faces[(np.abs(local) <= boxes.size[number] / 2).all(axis=(1, 2))]
        cosine = original.normals[whole] @ boxes.axes[number, 2]
        area = (original.areas[whole] * np.maximum(cosine, 0)).sum()
        score[number] = min(area / boxes.size[number, :2].prod(), 1.0)
    return score
