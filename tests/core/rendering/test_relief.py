import numpy as np
import pytest
from numpy.typing import NDArray

from core.gltf.scene import scene_of
from core.lab.plain import plain_glb
from core.metrics.ocr import ocr
from core.metrics.recognition import Reader
from core.rendering.pictures import DIRECTIONS, UPS
from core.rendering.relief import BACKGROUND, GROUND, relief, relief_pictures
from core.rendering.renderer import Renderer
from tests.core.lab.attacks.settings import mesh_of
from tests.core.placement.shapes import cuboid


def framed(depth: NDArray[np.float64]) -> NDArray[np.float32]:
    depth[[0, -1]] = depth[:, [0, -1]] = 0
    return depth.astype(np.float32)


def test_planes_are_plain_however_they_are_turned() -> None:
    rows, columns = np.mgrid[:32, :32]
    for depth in (np.full((32, 32), 100.0), 100 + 0.7 * columns, 100 - 0.3 * rows + 0.4 * columns):
        assert set(relief(framed(depth))[2:-2, 2:-2].ravel().tolist()) <= {GROUND - 1, GROUND, GROUND + 1}


def test_a_low_step_is_dark_at_its_foot_and_bright_at_its_rim() -> None:
    depth = np.full((32, 32), 100.0)
    depth[:, 16:] = 99.97  # nearer to the camera
    picture = relief(framed(depth))[16, :, 0]
    assert picture[15] < GROUND - 50
    assert picture[16] > GROUND + 50


def test_what_is_not_there_is_background() -> None:
    assert (relief(np.zeros((4, 4), dtype=np.float32)) == BACKGROUND).all()


@pytest.mark.parametrize("view", [0, 3])
def test_a_picture_shows_the_asset_without_its_light(view: int) -> None:
    with Renderer(256) as renderer:
        box = scene_of(plain_glb(mesh_of(cuboid(20, 20, 20))))
        picture = relief_pictures(box, renderer, DIRECTIONS[[view]], UPS[[view]])[0]
    assert (picture[..., 0] == picture[..., 2]).all()
    shown = picture[..., 0] != BACKGROUND
    assert 0.1 < shown.mean() < 0.9
    assert np.median(picture[shown]) == GROUND
    assert ocr(picture[None], ("watermark",), Reader()).ge_08 == 0
