"""Camera directions: the paper's 24 views and an even cover of the sphere."""

import numpy as np

from core.arrays import Bool, Float
from core.geometry.products import product

STEP = np.radians(30)
EYE_DISTANCE = 75.0  # of a camera from the middle of the size-30 frame
BLOCK = 512  # points at a time: these tables fit into a processor's cache
MARGIN = 1.03  # radius of what a camera sees over that of the asset


def view_directions() -> tuple[Float, Float]:
    """The 24 views of the paper: (24, 3) unit directions from the object to the camera, (24, 3) camera up vectors.

    The camera looks along -Z with +Y up (so the first direction is +Z); the first twelve views turn it about X in
    steps of 30 degrees, the other twelve about Y. Both turns contain the front view, so views 0 and 12 are the same;
    the views from behind (6 and 18) share their direction and differ in their up vector. The paper counts them all,
    and so do we.
    """
    angle = STEP * np.arange(12)
    zero, one = np.zeros(12), np.ones(12)
    sine, cosine = np.sin(angle), np.cos(angle)
    about_x = np.stack([zero, -sine, cosine], axis=1), np.stack([zero, cosine, sine], axis=1)
    about_y = np.stack([sine, zero, cosine], axis=1), np.stack([zero, one, zero], axis=1)
    return np.concatenate([about_x[0], about_y[0]]), np.concatenate([about_x[1], about_y[1]])


def field_of_view(radius: float) -> float:
    """Angle in radians at which a camera sees the whole sphere of a ``radius`` in size-30 units, with some margin."""
    return float(2 * np.arcsin(MARGIN * radius / EYE_DISTANCE))


def to_cameras(points: Float, directions: Float) -> Float:
    """(N, ..., 3) vectors from ``points`` (N, ..., 3) in the size-30 frame to one camera each, in the ``directions``
    (N, 3) from its middle."""
    cameras = EYE_DISTANCE * directions
    return np.asarray(cameras.reshape(len(cameras), *[1] * (points.ndim - 2), 3) - points)


def cosines_to_cameras(points: Float, vectors: Float, directions: Float) -> Float:
    """(N, D) cosines between unit ``vectors`` (N, 3) at ``points`` (N, 3) in the size-30 frame and the way from there
    to each of the cameras in the ``directions`` (D, 3) from its middle."""
    ahead = EYE_DISTANCE * product(vectors, directions.T) - np.einsum("ni,ni->n", vectors, points)[:, None]
    squared = EYE_DISTANCE**2 - 2 * EYE_DISTANCE * product(points, directions.T) + (points**2).sum(axis=1)[:, None]
    return np.asarray(ahead / np.sqrt(squared))


def looks_at_cameras(points: Float, vectors: Float, directions: Float, least: float) -> Bool:
    """(N, D) which unit ``vectors`` (N, 3) at ``points`` (N, 3) have a cosine, see :func:`cosines_to_cameras`, of at
    ``least`` this positive number."""
    result = np.empty((len(points), len(directions)), dtype=bool)
    for start in range(0, len(points), BLOCK):
        point, vector = points[start : start + BLOCK], vectors[start : start + BLOCK]
        ahead = EYE_DISTANCE * product(vector, directions.T)
        ahead -= (vector * point).sum(axis=1, keepdims=True)
        bound = product(point, -2 * EYE_DISTANCE * least**2 * directions.T)
        bound += least**2 * (EYE_DISTANCE**2 + (point**2).sum(axis=1, keepdims=True))
        np.copyto(result[start : start + BLOCK], (ahead > 0) & (np.square(ahead) >= bound))
    return result


def fibonacci_directions(count: int) -> Float:
    """(count, 3) unit directions spread evenly over the sphere: a Fibonacci lattice, its poles along Y."""
    index = np.arange(count) + 0.5
    height = 1 - 2 * index / count
    turn = np.pi * (1 + np.sqrt(5)) * index
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.sin(turn), height, radius * np.cos(turn)], axis=1)
