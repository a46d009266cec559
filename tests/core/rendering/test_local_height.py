"""Pictures of how far a surface stands out of its surroundings."""

import numpy as np
import pytest
from numpy.typing import NDArray

from core.rendering.local_height import RANGE, local_height
from core.rendering.relief import BACKGROUND, GROUND, relief

GRAIN, STEP = 2.0, 0.1


def plate(size: int = 240) -> NDArray[np.float32]:
    """A plate turned away from the camera, with background around it."""
    rows, columns = np.mgrid[:size, :size]
    depth = (100 + 0.01 * columns - 0.02 * rows).astype(np.float32)
    depth[:5] = depth[-5:] = depth[:, :5] = depth[:, -5:] = 0
    return np.asarray(depth)


def test_a_turned_plate_is_plain_and_what_is_not_there_is_background() -> None:
    picture = local_height(plate(), GRAIN, STEP)
    assert (np.abs(picture[90:150, 90:150].astype(int) - GROUND) <= 1).all()
    assert (picture[:5] == BACKGROUND).all()
    assert (local_height(np.zeros((64, 64), np.float32), GRAIN, STEP) == BACKGROUND).all()


@pytest.mark.parametrize("side", [-1, 1])
def test_a_raised_stroke_is_dark_all_over_and_a_sunk_one_bright(side: int) -> None:
    depth = plate()
    depth[110:130, 114:126] += side * STEP
    picture = local_height(depth, GRAIN, STEP)[..., 0].astype(int)
    assert (side * (picture[113:127, 117:123] - GROUND) > RANGE / 3).all()
    assert np.abs(picture[113:127, 60:80] - GROUND).max() < RANGE / 4


def test_a_stroke_shows_where_noise_hides_its_edges_from_relief_pictures() -> None:
    depth = plate()
    depth[depth > 0] += np.random.default_rng(0).normal(scale=STEP / 2, size=int((depth > 0).sum()))
    ground, stroke = np.s_[100:140, 60:90], np.s_[100:140, 114:126]
    depth[stroke] -= STEP

    def contrast(picture: NDArray[np.uint8]) -> float:
        """Of the stroke with the ground, in deviations of the latter."""
        grey = picture[..., 0].astype(float)
        return float(abs(grey[stroke].mean() - grey[ground].mean()) / grey[ground].std())

    assert contrast(local_height(depth, GRAIN, STEP)) > 4
    assert contrast(relief(depth)) < 1
