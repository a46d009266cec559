import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from core.errors import ErrorCode, MeshmarkError
from core.lab.attacks.attack import ATTACKS
from core.lab.baselines.invisible import bit_accuracy, embed, extract
from core.lab.plain import Mesh
from tests.core.lab.attacks.settings import target_of


def egg(vertices: int = 4000) -> Mesh:
    """A closed ellipsoid with vertices at many different distances from its centre."""
    turn = np.arange(vertices) * np.pi * (3 - np.sqrt(5))
    z = 1 - (2 * np.arange(vertices) + 1) / vertices
    ball = np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    return Mesh(ball * (15, 10, 8) + (0.5, -0.2, 0.1), ConvexHull(ball).simplices.astype(np.int64))


EGG = egg()
BITS = np.random.default_rng(5).random(64) < 0.5
MARKED = embed(EGG, BITS)


@given(bits=st.lists(st.booleans(), min_size=1, max_size=64), strength=st.floats(0.02, 0.2))
def test_what_was_embedded_is_read_back_without_the_original(bits: list[bool], strength: float) -> None:
    marked = embed(EGG, np.array(bits), strength)
    assert extract(marked, len(bits)).tolist() == bits


def test_the_mark_cannot_be_seen() -> None:
    moved = np.linalg.norm(MARKED.positions - EGG.positions, axis=1)
    assert moved.mean() < 0.02
    assert moved.max() < 15 / 64
    assert np.array_equal(MARKED.faces, EGG.faces)


def test_a_stronger_mark_moves_vertices_further() -> None:
    means = [np.abs(embed(EGG, BITS, strength).positions - EGG.positions).mean() for strength in (0.02, 0.05, 0.1)]
    assert means == sorted(means)


@pytest.mark.parametrize("name", ["rotate", "translate", "scale", "reexport"])
def test_the_mark_stays_where_vertices_stay_relative_to_each_other(name: str) -> None:
    attacked = ATTACKS[name](MARKED, target_of(EGG)).mesh
    assert bit_accuracy(BITS, extract(attacked)) == 1


@pytest.mark.parametrize("name", ["crop", "remesh", "decimate", "smooth"])
def test_the_mark_is_lost_where_vertices_are(name: str) -> None:
    attacked = ATTACKS[name](MARKED, target_of(EGG)).mesh
    assert bit_accuracy(BITS, extract(attacked, 64)) < 0.8


def test_vertices_that_are_written_several_times_count_once() -> None:
    soup = Mesh(MARKED.positions[MARKED.faces].reshape(-1, 3), np.arange(3 * len(MARKED.faces)).reshape(-1, 3))
    assert extract(soup).tolist() == BITS.tolist()
    assert extract(embed(soup, ~BITS)).tolist() == (~BITS).tolist()


def test_vertices_at_one_place_stay_together() -> None:
    soup = Mesh(EGG.positions[EGG.faces].reshape(-1, 3), np.arange(3 * len(EGG.faces)).reshape(-1, 3))
    assert len(np.unique(embed(soup, BITS).positions, axis=0)) == len(EGG.positions)


def test_too_few_vertices_for_the_bits_are_named() -> None:
    with pytest.raises(MeshmarkError) as refused:
        embed(egg(100), BITS)
    assert refused.value.code is ErrorCode.NO_PLACEMENT
    assert "100 vertices" in refused.value.message
    assert "64 bits" in refused.value.message


def test_a_ball_without_different_distances_is_refused() -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    with pytest.raises(MeshmarkError) as refused:
        embed(Mesh(corners, np.array([[0, 1, 2]])), np.array([True, False]))
    assert refused.value.code is ErrorCode.NO_PLACEMENT


def test_bit_accuracy_is_the_share_of_equal_bits() -> None:
    assert bit_accuracy(np.array([True, True, False, False]), np.array([True, False, False, False])) == 0.75
