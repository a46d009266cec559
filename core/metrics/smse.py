"""Sampled Mean Squared Error (paper, supplement "Asset Utility")."""

import numpy as np

from core.geometry.sampling import sample
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface

SAMPLES = 30_000


def smse(original_index: SpatialIndex, watermarked: Surface, rng: np.random.Generator) -> tuple[float, float]:
    """Mean distance (size-30 units) and mean squared distance of the watermarked surface to the original.

    Lower is better. Over 30,000 area samples. The paper speaks of the "inverse of the mean distance" where lower
    is better; the mean distance itself is what its numbers are.
    """
    points, face = sample(watermarked, SAMPLES, rng)
    # In the order of the faces neighbours follow each other, which the tree answers more than twice as fast.
    distance, _, _ = original_index.closest(points[np.argsort(face, kind="stable")])
    return float(distance.mean()), float((distance**2).mean())
