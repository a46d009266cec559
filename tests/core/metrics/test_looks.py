"""Where letters are looked for first: on the mark that a view shows largest, at its place in the picture."""

import numpy as np

from core.geometry.boxes import Boxes
from core.geometry.directions import view_directions
from core.gltf.scene import scene_of
from core.metrics.looks import first_looks
from core.rendering.renderer import Frame, Renderer
from tests.core.placement.shapes import box
from tests.core.rendering.glb import CORNERS, CUBE_FACES, GlbWriter, plain

FRAME = Frame((0.0, 0.0, 0.0), 9.0)
EVERYWHERE = np.ones((1, 24), dtype=bool)


def test_a_look_falls_on_the_mark_in_the_picture() -> None:
    """A small red cube is drawn where the mark stands."""
    place = np.array([4.0, 2.0, 5.0])
    writer = GlbWriter().mesh(CORNERS * 0.3 + place, CUBE_FACES, material=plain((1, 0, 0, 1), doubleSided=True))
    scene = scene_of(writer.mesh(CORNERS * 0.001 - place, CUBE_FACES).bytes())
    middle = (scene.surface.positions[:8].max(axis=0) + scene.surface.positions[:8].min(axis=0)) / 2
    looks, _ = first_looks(box(tuple(middle), size=(1, 0.5, 0.1)), EVERYWHERE, Frame((0.0, 0.0, 0.0), 30.0))
    with Renderer(256) as renderer:
        renderer.load(scene, Frame((0.0, 0.0, 0.0), 30.0))
        for view, (direction, up) in enumerate(zip(*view_directions(), strict=True)):
            if looks[view, 0] != looks[view, 0]:
                continue
            picture = renderer.render(direction, up).astype(int)
            rows, columns = np.nonzero(picture[..., 0] > picture[..., 1] + 50)
            np.testing.assert_allclose(looks[view] * 256, [columns.mean() + 0.5, rows.mean() + 0.5], atol=1.5)
    assert np.isfinite(looks[0]).all()


def test_of_several_marks_the_highest_one_is_looked_at() -> None:
    low, high = box((-4, 0, 0), size=(3, 0.5, 0.1)), box((4, 0, 0), size=(1, 1, 0.1))
    front = first_looks(Boxes.concat(low, high), np.ones((2, 24), dtype=bool), FRAME)[0][0]
    assert front[0] > 0.6
    hidden = np.array([[True] * 24, [False] * 24])
    assert first_looks(Boxes.concat(low, high), hidden, FRAME)[0][0, 0] < 0.4


def test_where_nothing_is_seen_there_is_no_look() -> None:
    assert np.isnan(first_looks(box((0, 0, 5)), ~EVERYWHERE, FRAME)[0]).all()
    assert np.isnan(first_looks(Boxes.empty(), np.empty((0, 24), dtype=bool), FRAME)[0]).all()


def test_letters_run_to_the_right_in_the_front_view_and_to_the_left_where_the_camera_stands_on_its_head() -> None:
    _, right = first_looks(box((1, 2, 3), size=(4, 1, 0.1)), EVERYWHERE, FRAME)
    assert right[0, 0] > 0
    np.testing.assert_allclose(right[0, 1], 0, atol=1e-9)
    assert right[6, 0] > 0  # turned about the axis along which they run
    assert right[18, 0] < 0
