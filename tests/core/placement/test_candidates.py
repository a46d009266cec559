import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.boxes import Boxes
from core.geometry.sampling import sample
from core.geometry.surface import Surface
from core.placement.candidates import along_strips, candidates, right_way_up, upright
from tests.core.placement.shapes import box, cuboid, rotation, sphere


def on(shape: Surface, size: tuple[float, float, float], number: int, radius: float) -> Boxes:
    points, face = sample(shape, number, np.random.default_rng(0))
    return candidates(points, shape.normals[face], size, radius)


unit = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.01)


@given(normal=unit)
def test_every_normal_gets_a_right_handed_frame_that_faces_along_it(normal: tuple[float, float, float]) -> None:
    n = np.array([normal]) / np.linalg.norm(normal)
    axes = upright(n)[0]
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1)
    assert np.allclose(axes[2], n[0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_exactly_axis_aligned_normals_make_a_frame(axis: int, sign: float) -> None:
    normal = np.zeros((1, 3))
    normal[0, axis] = sign
    axes = upright(normal)[0]
    assert np.isfinite(axes).all()
    assert np.array_equal(axes[2], normal[0])
    assert np.allclose(np.cross(axes[0], axes[1]), axes[2])


@given(normal=unit)
def test_text_stands_upright_away_from_the_poles(normal: tuple[float, float, float]) -> None:
    n = np.array([normal]) / np.linalg.norm(normal)
    if abs(n[0, 1]) < 0.9:
        axes = upright(n)[0]
        assert axes[1, 1] > 0
        assert axes[0, 1] == pytest.approx(0, abs=1e-12)


def test_on_top_text_reads_as_from_a_camera_tilted_up_from_the_front() -> None:
    top, below = upright(np.array([[0.0, 1, 0], [0.0, -1, 0]]))
    assert np.allclose(top[1], (0, 0, -1))
    assert np.allclose(top[0], (1, 0, 0))
    assert np.allclose(below[1], (0, 0, 1))
    assert np.allclose(below[0], (1, 0, 0))


def test_a_cube_gets_boxes_on_all_six_sides_each_facing_out() -> None:
    found = on(cuboid(30, 30, 30), (5.5, 1, 0.5), 2000, 2.0)
    assert np.isfinite(found.axes).all()
    assert np.abs(np.abs(found.center).max(axis=1) - 15).max() < 1e-9
    side = np.abs(found.center).argmax(axis=1) * 2 + (
        found.center[np.arange(len(found)), np.abs(found.center).argmax(axis=1)] > 0
    )
    assert set(side.tolist()) == set(range(6))
    assert (np.einsum("bi,bi->b", found.axes[:, 2], found.center) > 0).all()


def test_candidates_are_equidistant() -> None:
    found = on(sphere(10), (3, 0.6, 0.3), 3000, 1.5)
    apart = np.linalg.norm(found.center[:, None] - found.center[None], axis=2) + 100 * np.eye(len(found))
    assert apart.min() >= 1.5
    assert apart.min(axis=1).max() < 3.0


def test_the_far_side_of_a_thin_wall_does_not_turn_a_box() -> None:
    found = on(cuboid(20, 20, 0.05), (4, 1, 0.4), 2000, 1.0)
    inner = found[np.flatnonzero(np.abs(found.center[:, :2]).max(axis=1) < 8)]
    assert np.allclose(np.abs(inner.axes[:, 2, 2]), 1)
    assert np.array_equal(np.sign(inner.axes[:, 2, 2]), np.sign(inner.center[:, 2]))


def test_text_that_fitting_put_on_its_head_is_turned_and_covers_the_same() -> None:
    sound = box(axes=rotation((0, 0, 1), 20))
    tipped = Boxes(sound.center, sound.axes * [[[-1], [-1], [1]]], sound.size)
    assert right_way_up(sound).axes == pytest.approx(sound.axes)
    assert right_way_up(tipped).axes == pytest.approx(sound.axes)
    assert np.linalg.det(right_way_up(tipped).axes) == pytest.approx([1])


def starts(shape: Surface, narrow: float) -> Boxes:
    points, face = sample(shape, 8000, np.random.default_rng(0))
    return along_strips(
        candidates(points, shape.normals[face], (4, 0.5, 0.6), 1.0), points, shape.normals[face], narrow
    )


def sides(found: Boxes, room: float, length: float) -> Boxes:
    """Those on the sides of an upright bar, ``room`` away from its ends."""
    return found[np.flatnonzero((np.abs(found.axes[:, 2, 1]) < 0.1) & (np.abs(found.center[:, 1]) < length / 2 - room))]


def test_text_runs_along_an_upright_bar_that_is_narrower_than_the_text() -> None:
    found = sides(starts(cuboid(1, 30, 1), narrow=1.5), 2, 30)
    assert len(found) > 20
    assert np.allclose(np.abs(found.axes[:, 0, 1]), 1, atol=0.05)
    assert np.allclose(np.linalg.det(found.axes), 1)


def test_text_stays_upright_on_a_bar_that_has_room_and_at_the_edges_of_wide_faces() -> None:
    for shape in (cuboid(2, 30, 2), cuboid(30, 30, 30)):
        found = sides(starts(shape, narrow=1.5), 2, 30)
        assert len(found) > 20
        assert np.allclose(found.axes[:, 1, 1], 1, atol=0.01)


def test_text_along_a_lying_bar_is_what_upright_text_was_already() -> None:
    found = starts(cuboid(30, 1, 1), narrow=1.5)
    front = found[np.flatnonzero(found.axes[:, 2, 2] > 0.9)]
    assert len(front) > 5
    assert np.allclose(front.axes[:, 0, 0], 1, atol=0.05)


def test_few_samples_say_nothing_about_strips() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 1.0, 0.0]])
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    assert np.allclose(along_strips(box(), points, normals, 1.5).axes, box().axes)
