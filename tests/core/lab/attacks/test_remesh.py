import numpy as np
import pytest

from core.lab.attacks.remesh import remesh
from core.lab.plain import Mesh
from core.metrics.topology import topology
from tests.core.lab.attacks.settings import area, mesh_of, target_of, volume
from tests.core.placement.shapes import cuboid, inside_out, join, moved, plane, sphere


def box_volume(mesh: Mesh) -> float:
    return float(np.prod(np.ptp(mesh.positions, axis=0)))


@pytest.mark.parametrize("turned", [False, True])
def test_a_ball_is_found_again_within_a_voxel_whichever_way_its_faces_look(turned: bool) -> None:
    shape = sphere(3, rings=40)
    ball = mesh_of(inside_out(shape) if turned else shape)
    again = remesh(ball, target_of(ball), 1 / 32).mesh
    radius = np.linalg.norm(again.positions, axis=1)
    assert np.abs(radius - 3).max() < 6 / 32 / 4
    assert volume(again) == pytest.approx(36 * np.pi, rel=0.01)  # and it looks outwards
    assert topology(again.surface()).watertight


def test_voxels_are_as_large_as_the_strength_says() -> None:
    block = mesh_of(cuboid(4, 2, 2))
    coarse, fine = (len(remesh(block, target_of(block), strength).mesh.faces) for strength in (1 / 16, 1 / 32))
    assert 3.5 < fine / coarse < 4.5


def test_an_open_plate_becomes_a_thin_closed_one() -> None:
    sheet = mesh_of(plane(6, 4, cells=3))
    again = remesh(sheet, target_of(sheet), 1 / 48).mesh
    found = topology(again.surface())
    assert found.watertight
    assert found.components == 1
    assert np.ptp(again.positions, axis=0) == pytest.approx([6 + 1.8 / 8, 4 + 1.8 / 8, 1.8 / 8], abs=0.05)
    half = 0.9 / 8
    assert area(again) == pytest.approx(48 + 20 * np.pi * half, rel=0.02)  # both sides and a round rim


def test_a_bowl_is_closed() -> None:
    ball = mesh_of(sphere(3, rings=24))
    bowl = Mesh(ball.positions, ball.faces[ball.positions[ball.faces][:, :, 1].mean(axis=1) < 0.5])
    again = remesh(bowl, target_of(bowl), 1 / 40).mesh
    assert topology(again.surface()).watertight
    assert volume(again) > 0.9 * 18 * np.pi


def test_a_sheet_that_is_doubled_back_to_back_does_not_vanish() -> None:
    both = mesh_of(join(plane(6, 4), inside_out(plane(6, 4))))
    again = remesh(both, target_of(both), 1 / 32).mesh
    assert area(again) == pytest.approx(48 + 20 * np.pi * 0.9 * 6 / 32, rel=0.02)


def test_two_balls_that_overlap_become_one() -> None:
    pair = mesh_of(join(sphere(2, rings=12), moved(sphere(2, rings=12), shift=(2, 0, 0))))
    found = topology(remesh(pair, target_of(pair), 1 / 32).mesh.surface())
    assert found.watertight
    assert found.components == 1


def test_a_block_far_from_the_origin_stays_there() -> None:
    block = mesh_of(moved(cuboid(1, 1, 1), shift=(300, 0, -20)))
    again = remesh(block, target_of(block), 1 / 20).mesh
    assert again.positions.mean(axis=0) == pytest.approx([300, 0, -20], abs=0.01)
    assert box_volume(again) == pytest.approx(1, rel=0.05)
