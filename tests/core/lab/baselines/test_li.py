import numpy as np
import pytest

from core.lab.baselines.li import li
from core.metrics.topology import topology
from tests.core.lab.baselines.assets import asset, raised, same, wanted, watertight
from tests.core.shapes import box, sphere

BALL = asset(sphere(15, 4))


def test_there_are_exactly_as_many_marks_as_asked_for() -> None:
    marked = li(BALL, wanted(7), np.random.default_rng(0))
    assert len(marked.boxes) == len(marked.relief) == 7
    assert watertight(marked.mesh)


def test_each_mark_stands_along_the_normal_and_has_a_plane_top() -> None:
    marked = li(BALL, wanted(1), np.random.default_rng(0))
    outwards = marked.boxes.center[0] / np.linalg.norm(marked.boxes.center[0])
    assert marked.boxes.axes[0, 2] @ outwards > 0.99
    tops, distance = raised(BALL, marked)
    assert marked.boxes.to_local(0, tops)[:, 2] == pytest.approx(marked.relief[0])
    assert np.ptp(distance) > 0.01


def test_text_that_hangs_over_an_edge_leaves_letters_in_the_air() -> None:
    pole = asset(box(1, 30, 1))
    marked = li(pole, wanted(6, size=5.5), np.random.default_rng(0))
    assert topology(marked.mesh.surface()).components > 1


def test_the_same_seed_gives_the_same_mesh_and_another_seed_another() -> None:
    first, again, other = (li(BALL, wanted(3), np.random.default_rng(seed)).mesh for seed in (0, 0, 1))
    assert same(first, again)
    assert not same(first, other)
