import numpy as np
import pytest

from core.metrics.smse import smse
from tests.core.placement.shapes import cuboid, index_of, join, moved, plane, sphere


def test_an_untouched_asset_has_no_error() -> None:
    distance, squared = smse(index_of(sphere(5)), sphere(5), np.random.default_rng(0))
    assert distance < 1e-9
    assert squared < 1e-12


def test_a_lifted_patch_counts_by_its_area_and_height() -> None:
    ground = plane(10, 10)
    raised = join(ground, moved(plane(5, 5), shift=(0, 0, 0.4)))
    distance, squared = smse(index_of(ground), raised, np.random.default_rng(0))
    share = 25 / 125
    assert distance == pytest.approx(share * 0.4, rel=0.05)
    assert squared == pytest.approx(share * 0.16, rel=0.05)


def test_the_same_seed_gives_the_same_number() -> None:
    found = [smse(index_of(cuboid(1, 1, 1)), cuboid(1.1, 1, 1), np.random.default_rng(3)) for _ in range(2)]
    assert found[0] == found[1]
