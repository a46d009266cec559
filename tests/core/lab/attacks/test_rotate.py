import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from core.lab.attacks.rotate import rotate
from tests.core.lab.attacks.settings import boxes_at, mesh_of, target_of
from tests.core.placement.shapes import cuboid

BLOCK = mesh_of(cuboid(1, 2, 3))


@given(seed=st.integers(0, 2**32 - 1))
def test_rotation_keeps_every_distance_and_the_handedness(seed: int) -> None:
    attacked = rotate(BLOCK, target_of(BLOCK, seed))
    assert pdist(attacked.mesh.positions) == pytest.approx(pdist(BLOCK.positions))
    assert np.linalg.det(attacked.transform) == pytest.approx(1)
    assert np.array_equal(attacked.mesh.faces, BLOCK.faces)


@given(seed=st.integers(0, 2**32 - 1), strength=st.floats(0.01, 180))
def test_the_angle_stays_within_the_strength(seed: int, strength: float) -> None:
    turn = rotate(BLOCK, target_of(BLOCK, seed), strength).transform[:3, :3]
    assert np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) <= strength + 1e-4


def test_the_transform_says_what_was_done() -> None:
    attacked = rotate(BLOCK, target_of(BLOCK, boxes=boxes_at((0, 0, 1))))
    corners = np.column_stack([BLOCK.positions, np.ones(8)])
    assert (corners @ attacked.transform.T)[:, :3] == pytest.approx(attacked.mesh.positions)
    assert attacked.kept.tolist() == [True]
