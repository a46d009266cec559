import numpy as np
from numpy.typing import NDArray

from core.rendering.cavity import cavity

GREY = np.full((32, 32, 3), 150, dtype=np.uint8)
LIT = np.ones((32, 32), dtype=np.float32)


def framed(depth: NDArray[np.float64]) -> NDArray[np.float32]:
    depth = depth.copy()
    depth[[0, -1]] = depth[:, [0, -1]] = 0
    return depth.astype(np.float32)


def test_planes_keep_their_shade_however_they_are_turned() -> None:
    rows, columns = np.mgrid[:32, :32]
    for depth in (np.full((32, 32), 100.0), 100 + 0.7 * columns, 100 - 0.3 * rows + 0.4 * columns):
        np.testing.assert_array_equal(cavity(GREY, framed(depth), LIT), GREY)


def test_the_foot_of_a_step_darkens_and_its_rim_brightens() -> None:
    depth = np.full((32, 32), 100.0)
    depth[:, 16:] = 99.8  # nearer to the camera
    shaded = cavity(GREY, framed(depth), LIT)[16, :, 0]
    assert shaded[15] < 120
    assert shaded[16] > 160
    assert set(shaded[2:15]) == set(shaded[17:30]) == {150}


def test_the_outline_against_nothing_is_left_alone() -> None:
    depth = np.zeros((32, 32))
    depth[8:24, 8:24] = 100
    np.testing.assert_array_equal(cavity(GREY, framed(depth), LIT), GREY)


def test_what_no_light_shapes_is_left_as_it_is() -> None:
    depth = np.full((32, 32), 100.0)
    depth[:, 16:] = 99.8
    np.testing.assert_array_equal(cavity(GREY, framed(depth), 0 * LIT), GREY)


def test_what_reaches_the_rim_of_the_picture_is_left_alone_there() -> None:
    depth = np.full((32, 32), 100.0, dtype=np.float32)
    depth[:, 16:] = 99.8
    shown = cavity(GREY, depth, LIT)
    np.testing.assert_array_equal(shown[:, [0, -1]], GREY[:, [0, -1]])
    assert shown[16, 15, 0] < 120
