from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from core.geometry.spatial import SpatialIndex
from core.lab.attacks.fill import filled_fair, filled_flat, grown, lowered
from core.lab.plain import Mesh
from core.metrics.topology import topology
from tests.core.lab.attacks.settings import area, mesh_of
from tests.core.placement.shapes import join, moved, plane, sphere

GROUND = mesh_of(plane(4, 4, cells=8))


def within(mesh: Mesh, half: float) -> NDArray[np.bool_]:
    """Faces whose middle lies in a square round the origin."""
    return np.asarray((np.abs(mesh.positions[mesh.faces].mean(axis=1)[:, :2]) < half).all(axis=1))


def raised(mesh: Mesh, half: float, height: float) -> Mesh:
    positions = mesh.positions.copy()
    positions[(np.abs(positions[:, :2]) < half).all(axis=1), 2] += height
    return Mesh(positions, mesh.faces)


def test_a_hole_is_closed_flat_and_by_nothing_but_new_triangles() -> None:
    block = raised(GROUND, 1.1, 0.3)
    found = within(block, 1.6)
    filled, source = filled_flat(block, found)
    assert np.abs(filled.positions[:, 2]).max() == 0
    assert area(filled) == pytest.approx(16)
    assert topology(filled.surface()).components == 1
    assert np.array_equal(source[source >= 0], np.flatnonzero(~found))
    assert (source >= 0).sum() + (source < 0).sum() == len(filled.faces)


def test_an_island_in_a_hole_stays_where_it_is() -> None:
    ring = within(GROUND, 1.6) & ~within(GROUND, 0.6)
    filled, _ = filled_flat(GROUND, ring)
    assert area(filled) == pytest.approx(16)
    distance, _, _ = SpatialIndex(filled.positions, filled.faces).closest(GROUND.positions)
    assert distance.max() == 0


def test_two_holes_are_closed_each_by_itself() -> None:
    side = np.abs(GROUND.positions[GROUND.faces].mean(axis=1)[:, 0]) > 1
    found = side & within(GROUND, 1.9)
    assert area(filled_flat(GROUND, found)[0]) == pytest.approx(16)


def test_what_floats_is_cut_out_whole_and_has_nothing_to_be_pushed_back_onto() -> None:
    mesh = mesh_of(join(plane(4, 4, cells=8), moved(plane(1, 1), shift=(0, 0, 1))))
    found = mesh.positions[mesh.faces][:, :, 2].max(axis=1) > 0.5
    filled, source = filled_flat(mesh, found)
    assert area(filled) == pytest.approx(16)
    assert np.array_equal(source, np.flatnonzero(~found))
    for fill in (filled_fair, lowered):
        assert np.array_equal(fill(mesh, found).positions, mesh.positions)


@pytest.mark.parametrize("fill", [filled_fair, lowered])
def test_a_fair_filling_goes_on_as_the_surface_round_it_does(fill: Callable[[Mesh, NDArray[np.bool_]], Mesh]) -> None:
    ball = mesh_of(sphere(10))
    top = ball.positions[ball.faces].mean(axis=1)[:, 2] > 9
    dented = Mesh(ball.positions - [0, 0, 0.5] * (ball.positions[:, 2:] > 9.3), ball.faces)
    flat = SpatialIndex(*_parts(filled_flat(dented, top)[0])).closest(np.array([[0.0, 0.0, 10.0]]))[0][0]
    fair = SpatialIndex(*_parts(fill(dented, top))).closest(np.array([[0.0, 0.0, 10.0]]))[0][0]
    assert flat > 0.5
    assert fair < flat / 2


def test_nothing_found_is_nothing_changed() -> None:
    nothing = np.zeros(len(GROUND.faces), dtype=bool)
    filled, source = filled_flat(GROUND, nothing)
    assert np.array_equal(filled.positions, GROUND.positions)
    assert np.array_equal(source, np.arange(len(GROUND.faces)))
    for fill in (filled_fair, lowered):
        assert np.array_equal(fill(GROUND, nothing).positions, GROUND.positions)


def test_a_ring_more_takes_the_faces_that_share_a_corner() -> None:
    one = np.zeros(len(GROUND.faces), dtype=bool)
    one[40] = True
    rings = [int(grown(GROUND.faces, one, rings).sum()) for rings in (0, 1, 2)]
    assert rings[0] == 1
    assert rings[0] < rings[1] < rings[2] <= len(one)


def _parts(mesh: Mesh) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    return mesh.positions, mesh.faces
