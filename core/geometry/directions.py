"""Camera directions: the paper's 24 views and an even cover of the sphere."""

import numpy as np

from core.arrays import Float

STEP = np.radians(30)


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


def fibonacci_directions(count: int) -> Float:
    """(count, 3) unit directions spread evenly over the sphere: a Fibonacci lattice, its poles along Y."""
    index = np.arange(count) + 0.5
    height = 1 - 2 * index / count
    turn = np.pi * (1 + np.sqrt(5)) * index
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.sin(turn), height, radius * np.cos(turn)], axis=1)
