"""Success of a thief: how much of the clean shape is regained, and whether a watermark is left to be read."""

import numpy as np
from scipy.spatial import cKDTree

from core.arrays import Float
from core.geometry.boxes import Boxes
from core.geometry.sampling import sample
from core.geometry.spatial import SpatialIndex
from core.lab.plain import Mesh

SAMPLES = 400_000  # on each surface; those near the marks count
# Share of a mark's width, of its height, and size-30 units above and below it, that count as near it.
NEAR, DEEP = np.array([1.1, 1.3, 1.0]), np.array([0.0, 0.0, 0.6])
STRIPPED = 0.9  # share recovered from which on an asset counts as stripped, where nothing can be read any more:
NOISE = 0.1  # a ratio less than this above that of the asset without watermarks


def recovered(original: Mesh, marked: Mesh, after: Mesh, boxes: Boxes) -> float:
    """1 less the distance ``after`` an attack over that of the ``marked`` asset, both from the ``original``, near the
    marks: 1 is the clean shape, 0 no change, and less than 0 more damage than the marks did.

    The distance is the mean of that from one surface to the other and back, at even samples in the ``boxes``, which
    are made a little wider. All in the original's size-30 frame.
    """
    near = Boxes(boxes.center, boxes.axes, boxes.size * NEAR + DEEP)
    clean = SpatialIndex(original.positions, original.faces)
    there = _samples(original, near)

    def apart(mesh: Mesh) -> float:
        onward, _, _ = SpatialIndex(mesh.positions, mesh.faces).closest(there)
        back, _, _ = clean.closest(_samples(mesh, near))
        return float(onward.mean() + (back.mean() if len(back) else onward.mean())) / 2

    return 1 - apart(after) / apart(marked)


def _samples(mesh: Mesh, near: Boxes) -> Float:
    points, _ = sample(mesh.surface(), SAMPLES, np.random.default_rng(0))
    return np.asarray(points[np.unique(near.contained(cKDTree(points))[1])])
