import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import ErrorCode, MeshmarkError
from core.geometry.sampling import sample, thin
from tests.core.placement.shapes import cuboid, join, moved, plane, sphere, surface


def test_samples_are_uniform_by_area_whatever_the_tessellation() -> None:
    coarse, fine = plane(10, 10), moved(plane(10, 10, cells=30), shift=(0, 0, 5))
    points, face = sample(join(coarse, fine), 20_000, np.random.default_rng(0))
    assert (points[:, 2] > 2.5).mean() == pytest.approx(0.5, abs=0.02)
    assert (face >= 2).mean() == pytest.approx(0.5, abs=0.02)
    assert (points[:, 0] > 2.5).mean() == pytest.approx(0.25, abs=0.02)


def test_samples_lie_on_the_face_they_name() -> None:
    shape = sphere(5)
    points, face = sample(shape, 500, np.random.default_rng(1))
    height = np.einsum("ni,ni->n", points - shape.positions[shape.faces[face, 0]], shape.normals[face])
    assert np.abs(height).max() < 1e-12


def test_a_face_without_area_is_never_picked() -> None:
    good = plane(2, 2)
    shape = surface(good.positions, np.concatenate([[[0, 0, 1], [3, 3, 3]], good.faces, [[1, 1, 1]]]))
    _, face = sample(shape, 5_000, np.random.default_rng(2))
    assert set(face.tolist()) == {2, 3}


def test_a_surface_without_area_is_refused() -> None:
    shape = surface(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(MeshmarkError) as caught:
        sample(shape, 10, np.random.default_rng(0))
    assert caught.value.code is ErrorCode.NO_FACES


def test_the_same_seed_gives_the_same_samples() -> None:
    one, _ = sample(cuboid(1, 2, 3), 50, np.random.default_rng(7))
    two, _ = sample(cuboid(1, 2, 3), 50, np.random.default_rng(7))
    assert np.array_equal(one, two)


@given(seed=st.integers(0, 1000), radius=st.floats(0.05, 3))
def test_thinned_points_keep_their_distance_and_leave_no_gap(seed: int, radius: float) -> None:
    points = np.random.default_rng(seed).uniform(-2, 2, (120, 3))
    kept = thin(points, radius)
    apart = np.linalg.norm(points[kept][:, None] - points[kept][None], axis=2)
    assert apart[~np.eye(len(kept), dtype=bool)].min(initial=np.inf) >= radius
    assert np.linalg.norm(points[:, None] - points[kept][None], axis=2).min(axis=1).max() <= radius


def test_thinning_prefers_the_earlier_point() -> None:
    assert thin(np.array([[0.0, 0, 0], [0.5, 0, 0], [1.2, 0, 0]]), 1.0).tolist() == [0, 2]
