import numpy as np
import pytest

from core.lab.attacks.reexport import reexport
from core.lab.plain import Mesh
from core.metrics.topology import topology
from tests.core.lab.attacks.settings import area, mesh_of, target_of, volume
from tests.core.placement.shapes import moved, sphere


@pytest.mark.parametrize("strength", [1, 2, 3])
def test_the_shape_comes_back_within_single_precision(strength: int) -> None:
    ball = mesh_of(sphere(3))
    again = reexport(ball, target_of(ball), strength).mesh
    corners, expected = again.positions[again.faces], ball.positions[ball.faces]
    assert corners == pytest.approx(expected, abs=3e-6)
    assert volume(again) == pytest.approx(volume(ball), rel=1e-6)
    assert topology(again.surface()).watertight
    assert len(again.positions) == len(ball.positions)


def test_small_triangles_far_from_the_origin_may_melt_together_but_the_rest_stays() -> None:
    ball = mesh_of(moved(sphere(3), shift=(1000, 0, 0)))
    assert area(reexport(ball, target_of(ball)).mesh) == pytest.approx(area(ball), rel=1e-3)


def test_the_mesh_that_was_given_stays_as_it_was() -> None:
    ball = mesh_of(sphere(3, rings=6))
    before = Mesh(ball.positions.copy(), ball.faces.copy())
    reexport(ball, target_of(ball))
    assert np.array_equal(ball.positions, before.positions)
    assert np.array_equal(ball.faces, before.faces)
