import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from core.lab.attacks.translate import translate
from tests.core.lab.attacks.settings import boxes_at, mesh_of, target_of
from tests.core.placement.shapes import cuboid

BLOCK = mesh_of(cuboid(1, 2, 3))


@given(seed=st.integers(0, 2**32 - 1), strength=st.floats(0.01, 100))
def test_translation_moves_all_vertices_alike_by_the_strength_in_diagonals(seed: int, strength: float) -> None:
    attacked = translate(BLOCK, target_of(BLOCK, seed, boxes_at((0, 0, 1))), strength)
    shift = attacked.mesh.positions - BLOCK.positions
    assert shift == pytest.approx(np.tile(attacked.transform[:3, 3], (8, 1)))
    assert np.linalg.norm(shift[0]) == pytest.approx(strength * np.sqrt(14))
    assert pdist(attacked.mesh.positions) == pytest.approx(pdist(BLOCK.positions))
    assert attacked.kept.all()
