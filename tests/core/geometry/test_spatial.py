from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.arrays import Int
from core.geometry.spatial import Eye, Hides, SpatialIndex
from core.geometry.spatial_warp import WarpIndex
from tests.core.shapes import box, grid, join, moved, sphere

CUBE = box(2.0, 2.0, 2.0)
INDEX = SpatialIndex(CUBE.positions, CUBE.faces)


@given(st.lists(st.tuples(*[st.floats(-5, 5)] * 3), min_size=1, max_size=20))
def test_the_closest_point_of_a_cube_is_the_clamped_one(points: list[tuple[float, float, float]]) -> None:
    query = np.array(points)
    distance, face, nearest = INDEX.closest(query)
    outside = np.abs(query).max(axis=1) >= 1
    # A point that projects closer to an edge than the root of the machine's precision is put on the edge.
    assert np.allclose(nearest[outside], np.clip(query, -1, 1)[outside], atol=1e-7)
    assert np.allclose(distance, np.linalg.norm(query - nearest, axis=1), atol=1e-12)
    clamped = np.linalg.norm(query - np.clip(query, -1, 1), axis=1)
    assert np.allclose(distance[outside], clamped[outside], atol=1e-12)
    inside = ~outside
    assert np.allclose(distance[inside], 1 - np.abs(query).max(axis=1)[inside], atol=1e-12)
    assert np.allclose(np.einsum("ni,ni->n", CUBE.normals[face], nearest), 1.0)


def test_rays_meet_the_first_surface_on_their_way_whichever_side_it_shows() -> None:
    origins = np.array([[0.1, 0.2, 5.0], [0.1, 0.2, 0.0], [0.1, 0.2, 5.0], [3.0, 0.0, 5.0]])
    directions = np.array([[0.0, 0, -1], [0, 0, -1], [0, 0, -2], [0, 0, -1]])
    distance, face = INDEX.first_hit(origins, directions)
    assert np.allclose(distance[:3], [4.0, 1.0, 2.0])
    assert np.isinf(distance[3])
    assert face[3] == -1
    assert np.allclose(CUBE.normals[face[[0, 1]], 2], [1.0, -1.0])


def test_no_question_no_answer() -> None:
    nothing = np.empty((0, 3))
    assert [len(part) for part in INDEX.closest(nothing)] == [0, 0, 0]
    assert [len(part) for part in INDEX.first_hit(nothing, nothing)] == [0, 0]


def test_answers_do_not_depend_on_how_many_are_asked_at_once() -> None:
    ball = sphere(3.0, subdivisions=3)
    index = SpatialIndex(ball.positions, ball.faces)
    query = np.random.default_rng(0).normal(size=(50, 3)) * 4
    together = index.closest(query)
    alone = [index.closest(point[None]) for point in query]
    assert np.array_equal(together[0], np.concatenate([distance for distance, _, _ in alone]))
    assert np.array_equal(together[1], np.concatenate([face for _, face, _ in alone]))


def _hits(hides: Hides, eye: Eye | None, index: type[SpatialIndex] = SpatialIndex) -> list[float]:
    """Where rays through a cube meet it, from outside and from inside."""
    asked = index(CUBE.positions, CUBE.faces, hides=np.full(12, hides, dtype=np.uint8))
    origins, down = np.array([[0.1, 0.2, 5.0], [0.1, 0.2, 0.0]]), np.array([[0.0, 0, -1], [0, 0, -1]])
    distance, face = asked.first_hit(origins, down, eye)
    assert (np.isinf(distance) == (face < 0)).all()
    return [round(float(one), 6) for one in distance]


@pytest.mark.parametrize("index", [SpatialIndex, partial(WarpIndex, device="cpu")])
def test_an_eye_looks_through_backs_that_are_not_drawn_and_through_glass(index: type[SpatialIndex]) -> None:
    nothing = float("inf")
    assert _hits(Hides.FROM_FRONT, None, index) == [4.0, 1.0]
    assert _hits(Hides.FROM_FRONT, Eye.ORIGIN, index) == [4.0, nothing]
    assert _hits(Hides.FROM_FRONT, Eye.FAR, index) == [6.0, 1.0]
    assert _hits(Hides.NEVER, None, index) == [4.0, 1.0]
    assert _hits(Hides.NEVER, Eye.ORIGIN, index) == [nothing, nothing]
    assert _hits(Hides.ALWAYS, Eye.FAR, index) == [4.0, 1.0]


@pytest.mark.parametrize("index", [SpatialIndex, partial(WarpIndex, device="cpu")])
def test_through_many_panes_an_eye_sees_the_first_wall_and_its_own_number(index: type[SpatialIndex]) -> None:
    panes = join(*(moved(grid(4.0, 4.0, 1, 1), 0.0, 0.0, -0.5 * step) for step in range(30)))
    hides = np.full(60, Hides.NEVER, dtype=np.uint8)
    hides[50:] = Hides.ALWAYS
    counts = np.arange(10, 60)
    asked = index(panes.positions, panes.faces, counts, hides=hides)
    origins, down = np.tile([0.3, 0.1, 2.0], (3, 1)), np.array([[0.0, 0, -1], [0, 0, -4], [0, 0, 1]])
    distance, face = asked.first_hit(origins, down, Eye.ORIGIN)
    assert distance.tolist() == pytest.approx([14.5, 14.5 / 4, float("inf")])
    assert set(face[:2]) <= {50, 51}
    assert face[2] == -1
    assert asked.hiding(None).first_hit(origins, down, Eye.ORIGIN)[0][0] == pytest.approx(4.5)


@pytest.mark.parametrize("counts", [None, np.arange(10, 60)])
def test_an_index_over_the_faces_near_some_points_answers_as_that_over_all(counts: Int | None) -> None:
    panes = join(*(moved(grid(4.0, 4.0, 1, 1), 0.0, 0.0, -0.5 * step) for step in range(30)))
    whole = SpatialIndex(panes.positions, panes.faces, counts)
    points = np.array([[0.3, 0.1, -6.1], [1.0, -1.0, -6.9]])
    for answer, expected in zip(whole.among(np.arange(4, 34)).closest(points), whole.closest(points), strict=True):
        assert answer == pytest.approx(expected)
