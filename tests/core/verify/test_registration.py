"""A suspect finds its place on its original, however it was moved."""

from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from core.geometry.surface import Surface
from core.gltf.scene import scene_of
from core.lab.attacks.crop import clip
from core.lab.plain import Mesh
from core.verify.registration import Registration, Similarity, registrations
from tests.core.placement.shapes import cuboid
from tests.core.verify.test_verify import SPOT


@cache
def spot() -> Surface:
    return scene_of(SPOT).surface


def moved(surface: Surface, by: Similarity) -> Surface:
    """The surface moved in its frame."""
    return Mesh(by(surface.positions), surface.faces).surface()


def error(found: Registration, by: Similarity, surface: Surface) -> float:
    """The greatest distance of a point, moved and brought back, from where it was; size-30 units."""
    back = found.similarity(by(surface.positions))
    return float(np.linalg.norm(back - surface.positions, axis=1).max())


@settings(max_examples=2)
@given(
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.floats(0.2, 1.0),
    st.tuples(*[st.floats(-2, 2)] * 3),
)
def test_a_model_that_was_scaled_turned_and_moved_is_brought_back(
    turn: tuple[float, ...], scale: float, shift: tuple[float, ...]
) -> None:
    by = Similarity(scale, Rotation.from_rotvec(turn).as_matrix(), np.array(shift))
    found = registrations(moved(spot(), by), spot())[0]
    assert error(found, by, spot()) < 0.05
    assert found.residual < 1e-3
    assert found.covered > 0.99


def test_a_half_lies_where_it_did() -> None:
    mesh = Mesh(spot().positions, spot().faces)
    half = clip(mesh, mesh.positions @ np.array([0.6, 0.8, 0]))
    found = registrations(half.surface(), spot())[0]
    np.testing.assert_allclose(found.similarity(half.positions), half.positions, atol=0.02)
    assert found.residual < 1e-3
    assert 0.2 < found.covered < 0.8


def test_another_model_leaves_a_residual() -> None:
    assert registrations(cuboid(30, 20, 4), spot())[0].residual > 0.02


def test_a_nearly_round_plate_is_brought_back_by_its_corners() -> None:
    corners = [(-15, 8), (-8, 15), (8, 15), (15, 8), (15, -8), (8, -15), (-8, -15), (-15, -8)]
    plate = trimesh.convex.convex_hull(np.array([(x, y, z) for x, y in corners for z in (0.0, 0.3)]))
    surface = Mesh(np.asarray(plate.vertices), np.asarray(plate.faces)).surface()
    by = Similarity(0.4, Rotation.from_rotvec((0.7, -1.9, 0.4)).as_matrix(), np.array((1.0, -2, 0)))
    found = registrations(moved(surface, by), surface)
    # It looks the same in eight ways: all of them are given, and one is that in which it was turned.
    assert len(found) == 8
    assert min(error(one, by, surface) for one in found) < 0.05


def test_a_box_fits_itself_in_each_of_its_turns_and_as_it_is_first() -> None:
    box = cuboid(30, 20, 4)
    found = registrations(box, box)
    assert len(found) == 4
    np.testing.assert_allclose(found[0].similarity.rotation, np.eye(3), atol=1e-9)
    assert all(one.residual < 1e-6 and one.covered == 1 for one in found)
    again = [one.similarity.rotation for one in registrations(box, box)]
    np.testing.assert_array_equal(again, [one.similarity.rotation for one in found])


@pytest.mark.parametrize("scale", [0.5, 2])
def test_a_similarity_is_undone_by_its_inverse(scale: float) -> None:
    by = Similarity(scale, Rotation.from_rotvec([1, 2, 3]).as_matrix(), np.array([4.0, 5, 6]))
    points = np.array([[1.0, 2, 3], [-4, 5, 0.5]])
    np.testing.assert_allclose(by.inverse()(by(points)), points)
    np.testing.assert_allclose(by.after(by)(points), by(by(points)))
