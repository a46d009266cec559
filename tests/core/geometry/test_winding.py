from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from core.arrays import Float, Int
from core.geometry.winding import outward

BALL = trimesh.creation.icosphere(subdivisions=1)
SHAPES = [
    trimesh.creation.box(),
    BALL,
    trimesh.creation.torus(2.0, 0.5, major_sections=8, minor_sections=6),
    trimesh.creation.box(extents=(1, 1, 1e-4)),
]


def _parts(*parts: tuple[trimesh.Trimesh, float, Float]) -> tuple[Float, Int]:
    """Meshes, each scaled and moved, as one with vertices of their own."""
    start = np.cumsum([0, *(len(mesh.vertices) for mesh, _, _ in parts)])
    positions = np.concatenate([np.asarray(mesh.vertices) * scale + place for mesh, scale, place in parts])
    faces = np.concatenate(
        [mesh.faces + first for (mesh, _, _), (first, _) in zip(parts, pairwise(start), strict=True)]
    )
    return positions, faces.astype(np.int64)


def _reversed(faces: Int, which: np.ndarray) -> Int:
    return np.where(which[:, None], faces[:, ::-1], faces)


def _result(positions: Float, faces: Int) -> tuple[Int, bool]:
    """The faces as they come out, from their smallest corner on, and whether all are of closed parts."""
    found = outward(positions, faces)
    return _reversed(faces, found.flipped), bool(found.closed.all())


def _same_winding(one: Int, other: Int) -> bool:
    first, second = (
        np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1) for faces in (one, other)
    )
    return np.array_equal(first, second)


@given(shape=st.sampled_from(SHAPES), seed=st.integers(0, 2**32 - 1), share=st.floats(0, 1), soup=st.booleans())
def test_closed_meshes_with_any_faces_reversed_come_out_outwards(
    shape: trimesh.Trimesh, seed: int, share: float, soup: bool
) -> None:
    rng = np.random.default_rng(seed)
    positions, faces = _parts((shape, 10 ** rng.uniform(-3, 3), rng.uniform(-100, 100, 3)))
    if soup:  # as an STL has it: no corner is shared by number
        positions, faces = positions[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    found, closed = _result(positions, _reversed(faces, rng.random(len(faces)) < share))
    assert closed
    assert _same_winding(found, faces)


@given(seed=st.integers(0, 2**32 - 1), layers=st.integers(2, 5))
def test_of_nested_shells_every_other_one_looks_into_its_cavity(seed: int, layers: int) -> None:
    rng = np.random.default_rng(seed)
    order = rng.permutation(layers)
    nested = [(BALL, 2.0**-depth, np.array([3.0, 1.0, 2.0])) for depth in order.tolist()]
    positions, faces = _parts(*nested, (BALL, 1.0, np.array([-3.0, 0.0, 0.0])))
    mixed = np.arange(len(faces)) % len(BALL.faces)  # in each shell some faces either way: it does not say which way
    found, closed = _result(positions, _reversed(faces, (mixed == 0) | (rng.random(len(faces)) < 0.5) & (mixed > 1)))
    assert closed
    assert _same_winding(found, _reversed(faces, np.repeat([*(order % 2 == 1), False], len(BALL.faces))))


@pytest.mark.parametrize(
    ("in_file", "expected"),
    [
        ([False, True], [False, True]),  # a hollow body
        ([True, False], [False, True]),  # the same inside out
        ([False, False], [False, False]),  # a product in its case
        ([True, True], [False, False]),
    ],
)
def test_what_is_wound_against_its_holder_is_a_cavity_and_what_is_wound_like_it_a_solid(
    in_file: list[bool], expected: list[bool]
) -> None:
    positions, faces = _parts((BALL, 1.0, np.zeros(3)), (BALL, 0.3, np.array([0.2, 0.0, 0.0])))
    found, closed = _result(positions, _reversed(faces, np.repeat(in_file, len(BALL.faces))))
    assert closed
    assert _same_winding(found, _reversed(faces, np.repeat(expected, len(BALL.faces))))


def test_parts_beside_each_other_are_each_turned_by_themselves() -> None:
    places = [(BALL, 1.0, np.array([3.0 * number, 0.0, 0.0])) for number in range(4)]
    positions, faces = _parts(*places)
    found, closed = _result(positions, _reversed(faces, np.repeat([True, False, False, True], len(BALL.faces))))
    assert closed
    assert _same_winding(found, faces)


def test_blocks_that_touch_along_an_edge_are_closed_parts_of_their_own() -> None:
    block = trimesh.creation.box()
    positions, faces = _parts((block, 1.0, np.zeros(3)), (block, 1.0, np.array([1.0, 1.0, 0.0])))
    _, label = np.unique(positions, axis=0, return_inverse=True)
    positions, welded = np.unique(positions, axis=0), label.ravel()[faces]
    found, closed = _result(positions, _reversed(welded, np.arange(24) >= 12))
    assert closed
    assert _same_winding(found, welded)


def test_open_and_one_sided_surfaces_stay_as_they_are() -> None:
    steps = np.arange(16)
    angle = steps / 16 * 2 * np.pi
    half = (
        np.stack([np.cos(angle) * np.cos(angle / 2), np.sin(angle) * np.cos(angle / 2), np.sin(angle / 2)], axis=1) / 4
    )
    middle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    moebius = np.concatenate([middle - half, middle + half])
    following = np.where(steps == 15, 16, steps + 1), np.where(steps == 15, 0, steps + 17)
    strip = np.concatenate([np.stack([steps, following[0], steps + 16], 1), np.stack([steps + 16, *following], 1)])
    for positions, faces in ((moebius, strip), _parts((BALL, 1.0, np.zeros(3)))):
        found = outward(positions, faces[1:])
        assert not found.flipped.any()
        assert not found.closed.any()


def test_one_hole_does_not_keep_other_parts_from_being_turned() -> None:
    positions, faces = _parts((BALL, 1.0, np.zeros(3)), (BALL, 1.0, np.array([3.0, 0, 0])))
    found = outward(positions, faces[1:, ::-1])
    count = len(BALL.faces)
    assert found.flipped.tolist() == [False] * (count - 1) + [True] * count
    assert found.closed.tolist() == [False] * (count - 1) + [True] * count


def test_collapsed_triangles_and_pairs_back_to_back_do_no_harm() -> None:
    positions, faces = _parts((BALL, 1.0, np.zeros(3)))
    collapsed = np.concatenate([faces[:, ::-1], faces[:5, [0, 0, 1]], faces[:5, [2, 2, 2]]])
    found = outward(positions, collapsed)
    assert found.flipped.tolist() == [True] * len(faces) + [False] * 10
    assert found.closed.all()
    pair = outward(positions, np.array([[0, 1, 2], [2, 1, 0]]))
    assert not pair.flipped.any()
    assert pair.closed.all()
    twice = outward(positions, np.array([[0, 1, 2], [0, 1, 2]]))
    assert not twice.flipped.any()
    assert not twice.closed.any()


@given(seed=st.integers(0, 2**32 - 1))
def test_any_triangles_have_an_answer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.integers(0, 3, (12, 3)).astype(float)
    faces = rng.integers(0, 12, (rng.integers(1, 40), 3))
    found = outward(positions, faces)
    assert not (found.flipped & ~found.closed).any()
    once = outward(positions, _reversed(faces, found.flipped))
    np.testing.assert_array_equal(once.closed, found.closed)


def test_a_mesh_without_triangles_has_nothing_to_turn() -> None:
    assert len(outward(np.empty((0, 3)), np.empty((0, 3), np.int64)).flipped) == 0
