"""Semantics score: similarity of the asset before and after, by a vision model."""

from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from core.metrics.features import Extractor

Pictures = NDArray[np.uint8]

BATCH = 8  # pictures at once, which bounds the memory


def ss(original_pictures: Pictures, watermarked_pictures: Pictures, extractor: Extractor) -> float:
    """Mean over the views of the cosine between the features of the two pictures (supplement, "Semantics Score").

    1 means that nothing changed. Pictures that occur more than once, as views 0 and 12 of the paper's 24 do and as
    views without a watermark do on both sides, are looked at once.

    Args:
        original_pictures: (V, S, S, 3) uint8 sRGB, V >= 1.
        watermarked_pictures: the same views of the watermarked asset.
        extractor: see :func:`core.metrics.features.extractor`.
    """
    pictures = [*original_pictures, *watermarked_pictures]
    rows: dict[bytes, int] = {}
    row = np.array([rows.setdefault(sha256(picture).digest(), len(rows)) for picture in pictures])
    first = np.unique(row, return_index=True)[1]
    batches = (first[start : start + BATCH] for start in range(0, len(first), BATCH))
    batched = [extractor(np.stack([pictures[index] for index in batch])) for batch in batches]
    features = np.concatenate(batched).astype(np.float64)
    features /= np.maximum(np.linalg.norm(features, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    before, after = row.reshape(2, -1)
    cosine = (features[before] * features[after]).sum(axis=1)
    # Equal pictures are alike even where the features are all zero, as those of an empty picture may be.
    return float(np.where(before == after, 1.0, cosine).mean())
