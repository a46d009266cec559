import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.errors import ErrorCode, MeshmarkError
from core.geometry.surface import Surface
from core.lab.baselines.solid import solid, to_mesh
from tests.core.lab.baselines.assets import watertight
from tests.core.shapes import box, grid, join, moved, sphere, surface

BALL = sphere(15, 4)


def volume(shape: Surface) -> float:
    return float(solid(shape).volume())


def test_a_closed_box_is_a_solid_of_its_volume() -> None:
    assert volume(box(30, 20, 10)) == pytest.approx(6000)


def test_an_asset_that_is_inside_out_is_turned() -> None:
    assert volume(surface(BALL.positions, BALL.faces[:, ::-1])) == pytest.approx(volume(BALL))


def test_vertices_that_differ_by_rounding_are_merged() -> None:
    shape = box(30, 20, 10)
    torn = shape.positions[shape.faces.ravel()] + np.random.default_rng(0).uniform(-1e-8, 1e-8, (36, 3))
    assert volume(surface(torn, np.arange(36).reshape(-1, 3))) == pytest.approx(6000)


@settings(max_examples=15)
@given(st.sets(st.integers(0, len(BALL.faces) - 1), max_size=3))
def test_a_few_missing_faces_are_mended(missing: set[int]) -> None:
    body = solid(surface(BALL.positions, np.delete(BALL.faces, list(missing), axis=0)))
    assert watertight(to_mesh(body))
    assert body.volume() == pytest.approx(volume(BALL), rel=1e-2)


@settings(max_examples=15)
@given(st.integers(0, len(BALL.faces) - 1))
def test_a_turned_face_is_mended(turned: int) -> None:
    faces = BALL.faces.copy()
    faces[turned] = faces[turned][::-1]
    body = solid(surface(BALL.positions, faces))
    assert watertight(to_mesh(body))
    assert body.volume() == pytest.approx(volume(BALL), rel=1e-2)


@pytest.mark.parametrize(
    "shape",
    [
        grid(30, 30, 4, 4),
        surface(box(30, 20, 10).positions, box(30, 20, 10).faces[:-2]),
        join(sphere(10, 2), moved(grid(30, 10, 2, 2), 0, 0, 11)),
    ],
    ids=["a sheet", "a box without a side", "a ball and a sheet"],
)
def test_an_open_mesh_is_refused_with_its_own_code(shape: Surface) -> None:
    with pytest.raises(MeshmarkError) as refusal:
        solid(shape)
    assert refusal.value.code is ErrorCode.NOT_MANIFOLD


def test_the_refusal_counts_the_edges_without_a_partner() -> None:
    with pytest.raises(MeshmarkError, match="12 of its edges"):
        solid(grid(30, 30, 3, 3))
