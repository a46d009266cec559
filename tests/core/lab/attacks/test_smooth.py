import numpy as np
import pytest

from core.lab.attacks.smooth import smooth
from core.lab.plain import Mesh
from tests.core.lab.attacks.settings import mesh_of, target_of
from tests.core.placement.shapes import plane, sphere


def roughness(mesh: Mesh) -> float:
    """Deviation of the vertices' distances from the origin."""
    return float(np.linalg.norm(mesh.positions, axis=1).std())


def test_smoothing_takes_the_bumps_off_a_ball() -> None:
    ball = mesh_of(sphere(3))
    bumps = np.random.default_rng(0).normal(1, 0.02, (len(ball.positions), 1))
    bumpy = Mesh(ball.positions * bumps, ball.faces)
    found = [roughness(smooth(bumpy, target_of(ball), rounds).mesh) for rounds in (1, 3)]
    assert found[1] < found[0] < 0.6 * roughness(bumpy)


def test_one_step_moves_a_spike_half_way_to_the_mean_of_its_neighbours() -> None:
    sheet = mesh_of(plane(2, 2, cells=2))
    middle = int(np.flatnonzero((sheet.positions == 0).all(axis=1))[0])
    raised = sheet.positions.copy()
    raised[middle, 2] = 1
    after = smooth(Mesh(raised, sheet.faces), target_of(sheet), 1).mesh.positions
    assert after[middle] == pytest.approx([0, 0, 0.5])


def test_a_vertex_without_neighbours_stays() -> None:
    lonely = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9]]), np.array([[0, 1, 2], [3, 3, 3]]))
    assert smooth(lonely, target_of(lonely)).mesh.positions[3].tolist() == [9, 9, 9]


def test_a_face_that_is_a_line_pulls_nothing_towards_the_origin() -> None:
    flat = Mesh(np.array([[5.0, 0, 0], [5, 1, 0], [5, 0, 1]]), np.array([[0, 1, 2], [0, 0, 1]]))
    assert smooth(flat, target_of(flat)).mesh.positions[:, 0] == pytest.approx([5, 5, 5])
