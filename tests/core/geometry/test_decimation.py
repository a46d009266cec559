"""Triangles taken away: what has to stay of a surface."""

import numpy as np
import pytest
import trimesh

from core.arrays import Float, Int
from core.geometry.decimation import Corners, decimate
from core.geometry.edges import edge_table
from tests.core.gltf.builder import grid


def corners(points: Float, faces: Int, **given: Int) -> Corners:
    """Every vertex is a point of its own."""
    return Corners(faces, np.arange(len(points)), points, given.get("draws", np.ones(len(faces), dtype=np.int64)))


def ball(subdivisions: int = 4) -> tuple[Float, Int]:
    sphere = trimesh.creation.icosphere(subdivisions, radius=15)
    return np.asarray(sphere.vertices, float), np.asarray(sphere.faces, np.int64)


def sheet(side: int) -> tuple[Float, Int]:
    points, faces = grid(side)
    return points.astype(np.float64), faces


def area(points: Float, faces: Int) -> float:
    return float(trimesh.Trimesh(points, faces, process=False).area)


@pytest.mark.parametrize("target", [1000, 200])
def test_a_ball_stays_a_closed_ball_of_as_many_triangles_as_are_asked_for(target: int) -> None:
    points, faces = ball()
    left, source = decimate(corners(points, faces), target)
    assert target - 1 <= len(left) <= target
    mesh = trimesh.Trimesh(points, left)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert mesh.volume > 0.9 * trimesh.Trimesh(points, faces).volume
    assert (np.diff(source) > 0).all(), "each was one triangle of the surface, and they keep their order"


def test_no_vertex_moves_and_the_same_input_gives_the_same_triangles() -> None:
    points, faces = ball(3)
    one, two = (decimate(corners(points, faces), 300)[0] for _ in range(2))
    assert np.array_equal(one, two)
    assert np.isin(one, faces).all()


def test_of_a_flat_sheet_two_kinds_of_things_stay_its_outline_and_its_side() -> None:
    points, faces = sheet(16)
    left, _ = decimate(corners(points, faces), 40)
    assert len(left) <= 40
    assert area(points, left) == pytest.approx(256)
    turned = np.cross(points[left[:, 1]] - points[left[:, 0]], points[left[:, 2]] - points[left[:, 0]])
    assert (turned[:, 2] > 0).all()


def test_both_sides_of_a_seam_become_shorter_together() -> None:
    points, faces = sheet(12)
    right = points[faces].mean(axis=1)[:, 0] > 6
    on_seam = np.flatnonzero(points[:, 0] == 6)
    point = np.concatenate([np.arange(len(points)), on_seam])
    order = np.argsort(point, kind="stable")
    rank = np.empty(len(point), dtype=np.int64)
    rank[order] = np.arange(len(point))
    twin = np.arange(len(points))
    twin[on_seam] = len(points) + np.arange(len(on_seam))
    split = np.where(right[:, None], twin[faces], faces)
    given = Corners(rank[split], point[order], points[point[order]], np.ones(len(faces), dtype=np.int64))
    left, source = decimate(given, 60)
    assert len(left) <= 60
    assert area(given.values, left) == pytest.approx(144)
    mine = right[source]
    used = [set(np.unique(left[part]).tolist()) for part in (mine, ~mine)]
    assert not used[0] & used[1], "the sides have no corner in common"
    at_seam = [{tuple(given.values[c]) for c in side if given.values[c, 0] == 6} for side in used]
    assert at_seam[0] == at_seam[1], "and their vertices lie in the same places: there is no crack"
    assert 2 <= len(at_seam[0]) < 13


def test_a_line_that_attributes_draw_on_a_flat_sheet_stays() -> None:
    points, faces = sheet(16)
    colored = np.hstack([points, np.where(np.abs(points[:, :1] - 8) < 0.5, 1.0, 0.0)])
    left, _ = decimate(Corners(faces, np.arange(len(points)), colored, np.ones(len(faces), dtype=np.int64)), 200)
    plain, _ = decimate(corners(points, faces), 200)

    def ink(triangles: Int) -> float:
        a, b, c = (points[triangles[:, corner], :2] for corner in range(3))
        doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        return float((doubled / 2 * colored[triangles, 3].mean(axis=1)).sum())

    assert ink(left) == pytest.approx(ink(faces), rel=0.02)
    assert abs(ink(plain) - ink(faces)) > 0.1 * ink(faces)


def test_what_is_drawn_several_times_counts_as_often() -> None:
    points, faces = ball(3)
    left, source = decimate(corners(points, faces, draws=np.full(len(faces), 4)), 1600)
    assert len(left) <= 400
    assert len(source) == len(left)


def test_edges_of_three_triangles_stay_and_so_does_a_shape_that_would_be_lost() -> None:
    points, faces = sheet(4)
    fin = np.array([[2.0, 2.0, 3.0]])
    center = int(np.flatnonzero((points[:, 0] == 2) & (points[:, 1] == 2))[0])
    beside = int(np.flatnonzero((points[:, 0] == 3) & (points[:, 1] == 2))[0])
    all_points = np.concatenate([points, fin])
    all_faces = np.concatenate([faces, [[center, beside, len(points)]]])
    left, _ = decimate(corners(all_points, all_faces), 1)
    assert {center, beside, len(points)} <= set(left.ravel().tolist())
    cube = trimesh.creation.box((10, 10, 10))
    corners_of_cube = np.asarray(cube.faces, np.int64)
    kept, _ = decimate(corners(np.asarray(cube.vertices, float), corners_of_cube), 4)
    assert len(kept) == 12, "every collapse would cut a corner off"


def test_triangles_without_area_are_no_triangles() -> None:
    points, faces = sheet(2)
    left, source = decimate(corners(points, np.concatenate([faces, [[0, 0, 1]]])), 8)
    assert len(left) == 8
    assert len(faces) not in source
    assert edge_table(left).uses.max() == 2
