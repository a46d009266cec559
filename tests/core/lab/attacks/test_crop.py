import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from core.lab.attacks.crop import clip, crop
from core.lab.plain import Mesh
from core.metrics.topology import topology
from tests.core.lab.attacks.settings import area, boxes_at, mesh_of, target_of
from tests.core.placement.shapes import cuboid, plane, sphere


def rim(mesh: Mesh) -> NDArray[np.int64]:
    """(E, 2) the edges of one face only."""
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(unique[count == 1])


@given(seed=st.integers(0, 2**32 - 1))
def test_a_crop_through_the_centroid_leaves_half_of_a_cubes_surface(seed: int) -> None:
    cube = mesh_of(cuboid(2, 2, 2))
    assert area(crop(cube, target_of(cube, seed)).mesh) == pytest.approx(12, rel=1e-9)


@given(seed=st.integers(0, 2**32 - 1), strength=st.floats(0.01, 0.99))
def test_the_cut_is_straight_and_open(seed: int, strength: float) -> None:
    ball = mesh_of(sphere(3))
    rest = crop(ball, target_of(ball, seed), strength).mesh
    edges = rim(rest)
    ends = rest.positions[np.unique(edges)]
    assert len(edges) == len(np.unique(edges))  # one closed line
    assert np.linalg.svd(ends - ends.mean(axis=0), compute_uv=False)[2] < 1e-9


@given(seed=st.integers(0, 2**32 - 1), strength=st.floats(0.05, 0.95))
def test_both_sides_of_a_plane_make_the_whole(seed: int, strength: float) -> None:
    ball = mesh_of(sphere(3, rings=8))
    direction = np.random.default_rng(seed).normal(size=3)
    height = ball.positions @ direction
    height -= np.quantile(height, strength)
    assert area(clip(ball, height)) + area(clip(ball, -height)) == pytest.approx(area(ball), rel=1e-9)


def test_a_crop_removes_more_of_the_surface_the_stronger_it_is() -> None:
    ball = mesh_of(sphere(3))
    areas = [area(crop(ball, target_of(ball), strength).mesh) for strength in (0.001, 0.25, 0.5, 0.75, 0.999)]
    assert areas == sorted(areas, reverse=True)
    assert areas[0] == pytest.approx(area(ball), rel=0.01)
    assert areas[1] == pytest.approx(area(ball) * 0.75, rel=0.01)  # Archimedes' hat-box
    assert areas[4] < 0.01 * area(ball)


def test_a_cut_through_vertices_makes_no_slivers() -> None:
    sheet = mesh_of(plane(4, 4, cells=4))
    half = clip(sheet, sheet.positions[:, 0])
    assert len(half.faces) == 16
    assert len(half.positions) == 15
    assert area(half) == 8


def test_a_watermark_is_kept_if_none_of_its_box_is_cut_away() -> None:
    cube = mesh_of(cuboid(2, 2, 2))
    target = target_of(cube, boxes=boxes_at((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 0)))
    attacked = crop(cube, target)
    first, opposite, up, down, middle = attacked.kept
    assert first != opposite
    assert up != down
    assert not middle
    assert np.array_equal(attacked.transform, np.eye(4))


def test_a_cropped_ball_is_open_but_in_one_piece() -> None:
    ball = mesh_of(sphere(3))
    found = topology(crop(ball, target_of(ball)).mesh.surface())
    assert not found.watertight
    assert found.components == 1
