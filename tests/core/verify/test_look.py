"""Pixels of a look are places on the surface."""

from collections.abc import Iterator

import numpy as np
import pytest

from core.geometry.directions import EYE_DISTANCE
from core.gltf.scene import scene_of
from core.lab.plain import Mesh, plain_glb
from core.rendering.renderer import Frame, Renderer
from core.verify.look import look
from tests.core.placement.shapes import cuboid

FRONT, UP = np.array([0.0, 0, 1]), np.array([0.0, 1, 0])


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    box = cuboid(30, 20, 10)
    with Renderer(256) as one:
        one.load(scene_of(plain_glb(Mesh(box.positions, box.faces))))
        yield one


@pytest.mark.parametrize(
    ("direction", "axis", "level"),
    [((0, 0, 1), 2, 5.0), ((0, 0, -1), 2, -5.0), ((1, 0, 0), 0, 15.0), ((0.3, 0.2, 1), 2, 5.0)],
)
def test_the_middle_of_a_picture_shows_the_side_that_faces_the_camera(
    renderer: Renderer, direction: tuple[float, float, float], axis: int, level: float
) -> None:
    [point] = look(renderer, np.array(direction), UP).points(np.array([[128.0, 128.0]]))
    assert point[axis] == pytest.approx(level, abs=0.05)


def test_pixels_to_the_right_and_down_are_places_to_the_right_and_down(renderer: Renderer) -> None:
    one = look(renderer, FRONT, UP)
    shown = np.argwhere(one.depth > 0)
    (top, left), (bottom, right) = shown.min(axis=0), shown.max(axis=0)
    corners = one.points(np.array([[left + 0.5, top + 0.5], [right + 0.5, bottom + 0.5]]))
    np.testing.assert_allclose(corners, [[-15, 10, 5], [15, -10, 5]], atol=0.3)
    # Between them every pixel is as far from the next as the camera's distance makes it.
    middle = one.points(np.array([[128.0, 128], [138, 128]]))
    assert middle[1, 0] - middle[0, 0] == pytest.approx(10 * 2 * one.slope * (EYE_DISTANCE - 5) / 256, rel=1e-3)


def test_the_background_is_nowhere(renderer: Renderer) -> None:
    assert np.isnan(look(renderer, FRONT, UP).points(np.array([[2.0, 2.0], [-9, 400]]))).all()


def test_a_camera_that_is_turned_to_a_small_frame_sees_it_from_near_by(renderer: Renderer) -> None:
    renderer.aim(Frame((10.0, 5.0, 5.0), 1.0))
    near = look(renderer, FRONT, UP)
    np.testing.assert_allclose(near.points(np.array([[128.0, 128]])), [[10, 5, 5]], atol=0.02)
    left, right = near.points(np.array([[0.5, 128], [255.5, 128]]))
    assert right[0] - left[0] == pytest.approx(2, rel=0.1)
