import numpy as np
import pytest

from core.errors import ErrorCode, MeshmarkError
from core.lab.attacks.decimate import decimate
from core.lab.plain import Mesh
from core.metrics.topology import topology
from tests.core.lab.attacks.settings import area, mesh_of, target_of, volume
from tests.core.placement.shapes import join, moved, plane, sphere


@pytest.mark.parametrize("strength", [0.5, 0.9])
def test_a_ball_loses_the_asked_share_of_faces_and_little_of_its_volume(strength: float) -> None:
    ball = mesh_of(sphere(3, rings=40))
    coarse = decimate(ball, target_of(ball), strength).mesh
    assert len(coarse.faces) == pytest.approx(len(ball.faces) * (1 - strength), abs=2)
    assert volume(coarse) == pytest.approx(volume(ball), rel=0.03)
    assert topology(coarse.surface()).watertight


def test_an_open_plate_keeps_its_outline() -> None:
    sheet = mesh_of(plane(6, 4, cells=20))
    coarse = decimate(sheet, target_of(sheet)).mesh
    assert len(coarse.faces) <= 82
    assert area(coarse) == pytest.approx(24, rel=0.02)
    assert np.abs(coarse.positions[:, 2]).max() < 1e-9


def test_sheets_that_meet_at_one_edge_are_decimated_too() -> None:
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    fan = mesh_of(join(plane(4, 4, cells=12), moved(plane(4, 4, cells=12), turn)))
    coarse = decimate(fan, target_of(fan), 0.8).mesh
    assert len(coarse.faces) <= 0.22 * len(fan.faces)
    assert area(coarse) == pytest.approx(32, rel=0.05)


def test_faces_without_area_do_not_disturb() -> None:
    ball = mesh_of(sphere(3, rings=12))
    with_lines = Mesh(ball.positions, np.concatenate([ball.faces, [[0, 0, 1], [2, 2, 2]]]))
    assert volume(decimate(with_lines, target_of(ball), 0.5).mesh) == pytest.approx(volume(ball), rel=0.1)


def test_a_mesh_of_lines_is_refused() -> None:
    lines = Mesh(np.eye(3), np.array([[0, 1, 1]]))
    with pytest.raises(MeshmarkError) as refused:
        decimate(lines, target_of(lines))
    assert refused.value.code is ErrorCode.NO_FACES
