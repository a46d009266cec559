import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from core.lab.attacks.scale import scale
from tests.core.lab.attacks.settings import boxes_at, mesh_of, target_of
from tests.core.placement.shapes import cuboid

BLOCK = mesh_of(cuboid(1, 2, 3))


@given(seed=st.integers(0, 2**32 - 1), strength=st.floats(1.01, 100))
def test_scaling_multiplies_every_distance_by_one_factor_within_the_strength(seed: int, strength: float) -> None:
    attacked = scale(BLOCK, target_of(BLOCK, seed, boxes_at((0, 0, 1))), strength)
    factor = attacked.transform[0, 0]
    assert 1 / strength <= factor <= strength
    assert pdist(attacked.mesh.positions) == pytest.approx(factor * pdist(BLOCK.positions))
    assert attacked.kept.all()


def test_scaling_shrinks_as_often_as_it_grows() -> None:
    factors = [scale(BLOCK, target_of(BLOCK, seed)).transform[0, 0] for seed in range(200)]
    assert 70 < np.sum(np.array(factors) > 1) < 130
