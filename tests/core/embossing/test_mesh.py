import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.embossing.mesh import FaceGrid
from tests.core.embossing.bench import Bench, box_at
from tests.core.shapes import grid


@given(st.integers(0, 10**6), st.integers(1, 200), st.sampled_from([0.1, 0.9, 5.0]))
def test_the_grid_finds_exactly_the_faces_that_meet_a_box(seed: int, count: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    low = rng.uniform(-15, 15, (count, 3))
    high = low + rng.uniform(0, size, (count, 3))
    query_low = rng.uniform(-16, 16, 3)
    query_high = query_low + rng.uniform(0, 8, 3)
    wanted = np.flatnonzero(np.all((high >= query_low) & (low <= query_high), axis=1))
    assert FaceGrid(low, high).overlapping(query_low, query_high).tolist() == wanted.tolist()


def test_new_corners_remember_where_in_their_source_face_they_stand() -> None:
    bench = Bench(grid(10.0, 4.0, 20, 8))
    bench.emboss(box_at())
    edit = bench.edit()
    corners = bench.surface.positions[bench.surface.faces[edit.source_face]]
    foot = np.einsum("mkc,mcj->mkj", edit.barycentric, corners)
    on_sheet = edit.position[..., 2] == 0
    assert np.allclose(foot[on_sheet], edit.position[on_sheet], atol=1e-9)
    # Tops lean away from their feet, by less than a stroke.
    assert np.linalg.norm((foot - edit.position)[~on_sheet][:, :2], axis=1).max() < 0.1
    is_original = edit.original >= 0
    assert is_original.any()
    assert np.array_equal(bench.surface.positions[edit.original[is_original]], edit.position[is_original])


def test_equal_ids_are_equal_points() -> None:
    bench = Bench(grid(10.0, 4.0, 20, 8))
    bench.emboss(box_at())
    edit = bench.edit()
    flat, positions = edit.vertex.ravel(), edit.position.reshape(-1, 3)
    _, first, inverse = np.unique(flat, return_index=True, return_inverse=True)
    assert np.array_equal(positions[first][inverse], positions)
