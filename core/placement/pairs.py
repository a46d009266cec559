"""Pairs of marks: near each other, in a stack, or beside each other off one baseline."""

import numpy as np
from scipy.spatial.distance import cdist

from core.arrays import Bool, Float
from core.geometry.boxes import Boxes
from core.geometry.products import product

ALIKE = np.cos(np.radians(30.0))  # marks that look so far the same way stand on one face
PARALLEL = np.cos(np.radians(10.0))  # lines of text
LEVEL = np.sin(np.radians(3.0))  # of one line against another on its baseline, at most
STACKED = 0.3  # share of the shorter line that is above or below the other, at least
LEADING = 4.0  # heights of the higher line between two lines that look like a stack, at most
OFF = 0.1  # heights of the higher line by which baselines may differ


def proximity(boxes: Boxes, others: Boxes, reach: float) -> Float:
    """(B, K) 1 less the distance of the centres of ``boxes`` and ``others`` over ``reach`` (size-30 units), at least 0,
    for those on the same side of the surface; 0 for others."""
    apart = cdist(boxes.center, others.center)
    return np.asarray(np.maximum(1 - apart / reach, 0) * (product(boxes.axes[:, 2], others.axes[:, 2].T) > 0))


def stacked(boxes: Boxes, others: Boxes) -> Bool:
    """(B, K) pairs of parallel lines on one face, one of them above the other."""
    return _stacked(boxes, others) | _stacked(others, boxes).T


def ragged(boxes: Boxes, others: Boxes) -> Bool:
    """(B, K) pairs on one face that stand beside each other within a text's width, but not on one baseline."""
    return _ragged(boxes, others) | _ragged(others, boxes).T


def _stacked(boxes: Boxes, others: Boxes) -> Bool:
    along, across, face = _offset(boxes, others)
    shorter, taller = (choose(boxes.size[:, None], others.size) for choose in (np.minimum, np.maximum))
    over = _gap(boxes, others, along) < -STACKED * shorter[..., 0]
    parallel = np.abs(product(boxes.axes[:, 0], others.axes[:, 0].T)) > PARALLEL
    return np.asarray(face & parallel & over & (np.abs(across) < LEADING * taller[..., 1]))


def _ragged(boxes: Boxes, others: Boxes) -> Bool:
    along, across, face = _offset(boxes, others)
    larger, gap = np.maximum(boxes.size[:, None], others.size), _gap(boxes, others, along)
    beside = face & (gap > 0) & (gap < larger[..., 0]) & (np.abs(across) < larger[..., 1])
    # Letters stand on their baselines, wherever the middles of the lines are.
    base = across + (boxes.size[:, None, 1] - others.size[:, 1]) / 2
    turned = np.abs(product(boxes.axes[:, 1], others.axes[:, 0].T))
    return np.asarray(beside & ((np.abs(base) > OFF * larger[..., 1]) | (turned > LEVEL)))


def _offset(boxes: Boxes, others: Boxes) -> tuple[Float, Float, Bool]:
    """(B, K) each: how far the centres of ``others`` are to the right of the ``boxes`` and above them, and which stand
    on one face with them."""
    offset = others.center - boxes.center[:, None]
    along, across, off = (np.einsum("bki,bi->bk", offset, boxes.axes[:, axis]) for axis in range(3))
    face = product(boxes.axes[:, 2], others.axes[:, 2].T) > ALIKE
    return along, across, face & (np.abs(off) < np.maximum(boxes.size[:, 1:2], others.size[:, 1]))


def _gap(boxes: Boxes, others: Boxes, along: Float) -> Float:
    """(B, K) between the ends of two texts, whose centres are ``along`` (B, K) from each other; negative where they
    overlap."""
    return np.asarray(np.abs(along) - (boxes.size[:, :1] + others.size[:, 0]) / 2)
