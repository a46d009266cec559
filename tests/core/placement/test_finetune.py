import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from core.arrays import Float
from core.geometry.boxes import Boxes
from core.geometry.sampling import sample
from core.geometry.surface import Surface
from core.placement.candidates import candidates
from core.placement.finetune import (
    ADAM,
    LEVENBERG_MARQUARDT,
    AdamOptions,
    LevenbergMarquardtOptions,
    adam,
    alignment_loss,
    levenberg_marquardt,
    loss_limit,
    perimeter,
)
from tests.core.placement.shapes import box, boxes, cuboid, index_of, moved, plane, planes_of, rotation, sphere

TILTED = box((1, 2, 0.4), (5.5, 1, 0.5), rotation((1, 1, 0), 20))


def started(shape: Surface, size: tuple[float, float, float], number: int, radius: float) -> Boxes:
    points, face = sample(shape, number, np.random.default_rng(0))
    return candidates(points, shape.normals[face], size, radius)


def fitted_to(
    shape: Surface, start: Boxes, options: LevenbergMarquardtOptions = LEVENBERG_MARQUARDT
) -> tuple[Boxes, Float]:
    return levenberg_marquardt(start, planes_of(shape), torch.device("cpu"), options=options)


def test_the_loss_has_179_points_on_the_outline_with_all_four_midpoints() -> None:
    points = perimeter(np.array([[5.5, 1.0, 0.5], [2.0, 2.0, 0.3]]))
    assert points.shape == (2, 179, 3)
    assert np.all(points[..., 2] == 0)
    for outline, (width, height) in zip(points, ((5.5, 1.0), (2.0, 2.0)), strict=True):
        on_side = np.isclose(np.abs(outline[:, 0]), width / 2) | np.isclose(np.abs(outline[:, 1]), height / 2)
        assert on_side.all()
        corners = {(x, y) for x, y in np.round(outline[:, :2], 9).tolist()}
        assert {(sx * width / 2, sy * height / 2) for sx in (-1, 1) for sy in (-1, 1)} <= corners
        gaps = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
        assert gaps.max() < 1.1 * gaps.min()


def test_the_loss_is_the_mean_squared_distance_of_the_outline() -> None:
    index = index_of(plane(30, 30))
    assert alignment_loss(box((0, 0, 0)), index)[0] == pytest.approx(0)
    assert alignment_loss(box((0, 0, 0.3)), index)[0] == pytest.approx(0.09)


@settings(max_examples=15)
@given(degrees=st.floats(0, 360), axis=st.sampled_from([(1, 0, 0), (0, 1, 0), (1, 2, 3)]), x=st.floats(-5, 5))
def test_the_loss_does_not_depend_on_where_the_asset_stands(
    degrees: float, axis: tuple[float, float, float], x: float
) -> None:
    shape, turn, shift = sphere(6, rings=8), rotation(axis, degrees), np.array([x, 1, 2])
    here = box((0, 0, 6.1), (3, 1, 0.3))
    there = Boxes(here.center @ turn.T + shift, here.axes @ turn.T, here.size)
    expected = alignment_loss(here, index_of(shape))
    assert alignment_loss(there, index_of(moved(shape, turn, shift))) == pytest.approx(expected)


def test_levenberg_marquardt_lays_a_tilted_box_flat_on_a_plane() -> None:
    fitted, loss = fitted_to(plane(30, 30), TILTED)
    assert loss[0] < 1e-8
    assert abs(fitted.center[0, 2]) < 1e-3
    assert fitted.axes[0, 2] == pytest.approx([0, 0, 1], abs=1e-3)
    assert np.allclose(fitted.axes[0] @ fitted.axes[0].T, np.eye(3), atol=1e-9)


def test_levenberg_marquardt_lets_a_ball_pass_through_the_middle_of_the_box() -> None:
    shape = sphere(10, rings=48)
    fitted, loss = fitted_to(shape, box((0, 0, 10.5), (3, 0.6, 0.4), rotation((0, 1, 0), 15)))
    assert loss[0] < ADAM.threshold
    outward = fitted.center[0] / np.linalg.norm(fitted.center[0])
    assert fitted.axes[0, 2] @ outward == pytest.approx(1, abs=0.01)
    assert 10 - 1.5**2 / 20 < np.linalg.norm(fitted.center[0]) < 10  # between the sagitta's depth and the top


def test_levenberg_marquardt_pulls_a_box_back_from_an_edge() -> None:
    fitted, loss = fitted_to(plane(30, 30), box((14, 0, 0.1), (5.5, 1, 0.5)))
    assert loss[0] < ADAM.threshold
    assert fitted.center[0, 0] < 12.5


def test_a_box_with_nowhere_to_lie_is_given_up_and_the_others_are_not_disturbed() -> None:
    ball, small = sphere(1.5), box((0, 0, 1.5), (0.8, 0.2, 0.2))
    alone, _ = fitted_to(ball, small)
    together, loss = fitted_to(ball, boxes(box((0, 0, 1.5), (9, 4, 0.5)), small))
    assert np.isinf(loss[0])
    assert loss[1] < ADAM.threshold
    assert np.allclose(together.center[1], alone.center[0], atol=1e-9)


def test_fitted_text_on_a_ball_stays_nearly_upright() -> None:
    shape = sphere(12)
    start = started(shape, (4, 0.8, 0.4), 400, 3.0)
    fitted, loss = fitted_to(shape, start)
    good = loss < ADAM.threshold
    away_from_poles = np.abs(fitted.axes[:, 2, 1]) < 0.8
    roll = np.degrees(np.arcsin(np.abs(fitted.axes[good & away_from_poles, 0, 1])))
    assert good.mean() > 0.95
    assert np.median(roll) < 3


def test_adam_brings_a_tilted_box_below_the_papers_threshold() -> None:
    fitted, loss = adam(TILTED, index_of(plane(30, 30)))
    assert loss[0] < ADAM.threshold
    assert loss == pytest.approx(alignment_loss(fitted, index_of(plane(30, 30))))
    assert np.allclose(fitted.axes[0] @ fitted.axes[0].T, np.eye(3), atol=1e-9)


def test_adam_stops_each_box_by_its_own_loss() -> None:
    index = index_of(plane(30, 30))
    aligned = box((3, 3, 0.01))
    fitted, loss = adam(boxes(aligned, TILTED), index)
    assert np.array_equal(fitted.center[0], aligned.center[0])
    assert np.array_equal(fitted.axes[0], aligned.axes[0])
    alone, _ = adam(TILTED, index)
    assert np.allclose(fitted.center[1], alone.center[0])
    assert (loss < ADAM.threshold).all()


def test_adam_gives_up_after_200_steps_where_no_place_fits() -> None:
    steps: list[float] = []
    _, loss = adam(box((0, 0, 1), (9, 4, 0.5)), index_of(sphere(1.0, rings=6)), steps.append)
    assert loss[0] > ADAM.threshold
    assert len(steps) == 201
    assert steps[-1] == 1.0


def test_both_solvers_serve_faces_exactly_along_every_axis() -> None:
    shape = cuboid(20, 20, 20)
    start = started(shape, (4, 0.8, 0.4), 60, 4.0)
    for fitted, loss in (fitted_to(shape, start), adam(start, index_of(shape))):
        assert np.isfinite(fitted.center).all()
        assert np.isfinite(fitted.axes).all()
        assert (loss < ADAM.threshold).mean() > 0.9


def test_adam_takes_as_many_steps_as_asked_for() -> None:
    steps: list[float] = []
    adam(box((0, 0, 1), (9, 4, 0.5)), index_of(sphere(1.0, rings=6)), steps.append, AdamOptions(steps=4))
    assert steps == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_long_text_may_follow_a_ball_round_as_far_as_the_options_say() -> None:
    ball, long = sphere(7, rings=48), box((0, 0, 7), (4.6, 0.6, 0.7))
    for options, aligned in ((LEVENBERG_MARQUARDT, True), (LevenbergMarquardtOptions(bend=0.0), False)):
        _, loss = fitted_to(ball, long, options)
        assert bool(loss[0] < loss_limit(long.size, options)[0]) == aligned
