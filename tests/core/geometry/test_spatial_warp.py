"""Warp's index answers what the CPU's does; its kernels are the same on every device."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.arrays import Bool, Float, Int
from core.formats.admission import admit, document_of
from core.geometry.spatial import SpatialIndex
from core.geometry.spatial_warp import WarpIndex
from core.geometry.surface import Surface
from core.gltf.scene import flatten
from core.parameters import Parameters
from core.pipeline import watermark
from tests.core.formats.meshes import MESHES
from tests.core.shapes import box, grid, join, moved, sphere

DEVICES = ["cpu", "cuda"] if torch.cuda.is_available() else ["cpu"]
on_each_device = pytest.mark.parametrize("device", DEVICES)

SPOT = Path(__file__).parents[2] / "data" / "spot.glb"
NAMES = ("fox.glb", "suzanne.obj", "nonmanifold-crash.obj", "self-intersect-a.obj", "tray-bottom-cad.stl")
ASSETS = [SPOT, *(path for name in NAMES if (path := MESHES / name).exists())]

GRAZING = 1e-5  # of the extent


def read(path: Path) -> Surface:
    data = path.read_bytes()
    return flatten(document_of(admit(data))).surface


def around(positions: Float, count: int, seed: int = 0) -> Float:
    """Points inside, beside and far outside of a mesh."""
    rng = np.random.default_rng(seed)
    low, high = positions.min(axis=0), positions.max(axis=0)
    spread = rng.choice([0.5, 1.0, 10.0], (count, 1)) * max(float((high - low).max()), 1e-3)
    return np.asarray((low + high) / 2 + rng.uniform(-1, 1, (count, 3)) * spread)


def rays(positions: Float, count: int) -> tuple[Float, Float]:
    """From all around to points of the box around the mesh, of all lengths."""
    rng = np.random.default_rng(1)
    origins = around(positions, count, seed=2)
    targets = rng.uniform(positions.min(axis=0), positions.max(axis=0), (count, 3))
    return origins, (targets - origins) * rng.uniform(0.1, 10, (count, 1))


def gap(one: Float, other: Float) -> Float:
    """How far apart distances are; two misses are not."""
    both_miss = np.isinf(one) & np.isinf(other)
    return np.asarray(np.abs(np.where(both_miss, 0.0, one) - np.where(both_miss, 0.0, other)))


def grazing(index: SpatialIndex, origins: Float, directions: Float) -> Bool:
    """Rays that find something else when they are shifted sideways by ``GRAZING``."""
    extent = float(np.ptp(index.positions[index.faces].reshape(-1, 3), axis=0).max())
    length = np.linalg.norm(directions, axis=1)
    side = np.cross(directions, np.eye(3)[np.abs(directions).argmin(axis=1)])
    side *= GRAZING * extent / np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(directions / length[:, None], side)
    distance, _ = index.first_hit(origins, directions)
    unstable = np.zeros(len(origins), dtype=bool)
    for shift in (side, -side, other, -other):
        shifted, _ = index.first_hit(origins + shift, directions)
        unstable |= gap(distance, shifted) * length > 1e-2 * extent
    return unstable


def on_face(positions: Float, faces: Int, face: Int, points: Float) -> Float:
    """The distance of each point to the face it was said to lie on."""
    return np.array(
        [
            SpatialIndex(positions, faces[[one]]).closest(point[None])[0][0]
            for one, point in zip(face, points, strict=True)
        ]
    )


@on_each_device
@pytest.mark.parametrize("path", ASSETS, ids=lambda path: path.stem)
def test_real_assets_have_the_same_closest_points_and_first_hits(path: Path, device: str) -> None:
    asset = read(path)
    reference, index = (
        SpatialIndex(asset.positions, asset.faces),
        WarpIndex(asset.positions, asset.faces, device=device),
    )
    points = np.concatenate([around(asset.positions, 2000), asset.positions[:500]])
    expected, _, _ = reference.closest(points)
    distance, face, nearest = index.closest(points)
    assert np.abs(distance - expected).max() < 1e-6
    assert np.allclose(np.linalg.norm(points - nearest, axis=1), distance, atol=1e-12)
    assert on_face(asset.positions, asset.faces, face[::50], nearest[::50]).max() < 1e-9

    origins, directions = rays(asset.positions, 3000)
    clear = ~grazing(reference, origins, directions)
    assert clear.mean() > 0.9
    length = np.linalg.norm(directions, axis=1)
    there, here = reference.first_hit(origins, directions), index.first_hit(origins, directions)
    assert np.isfinite(there[0]).mean() > 0.2
    assert np.array_equal(np.isinf(here[0][clear]), np.isinf(there[0][clear]))
    # The reference is single precision: its distances are off by more where rays are long or meet faces at an angle.
    assert (gap(here[0], there[0]) * length)[clear].max() < 1e-2
    assert np.array_equal(here[1] < 0, np.isinf(here[0]))


coordinates = st.floats(-10, 10, width=32) | st.sampled_from([0.0, 1.0, 1 + 1e-7, 1e-6])
meshes = st.integers(3, 9).flatmap(
    lambda vertices: st.tuples(
        arrays(np.float64, (vertices, 3), elements=coordinates),
        arrays(np.int64, st.tuples(st.integers(1, 12), st.just(3)), elements=st.integers(0, vertices - 1)),
    )
)


def brute_force(positions: Float, faces: Int, points: Float) -> Float:
    """Distances to all triangles, without any hierarchy: the least over their edges and insides."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    best = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        squared = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
        share = np.clip(((points[:, None] - start) * along).sum(axis=2) / squared, 0, 1)
        foot = start + share[..., None] * along
        best = np.minimum(best, np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1))
    for k in range(len(faces)):
        edges = np.stack([b[k] - a[k], c[k] - a[k]], axis=1)
        if np.linalg.matrix_rank(edges) < 2:
            continue
        weights = np.linalg.lstsq(edges, (points - a[k]).T, rcond=None)[0].T
        inside = (weights >= 0).all(axis=1) & (weights.sum(axis=1) <= 1)
        foot = a[k] + weights @ edges.T
        best = np.where(inside, np.minimum(best, np.linalg.norm(points - foot, axis=1)), best)
    return best


@on_each_device
@settings(max_examples=150)
@given(mesh=meshes, scale=st.sampled_from([1e-3, 1.0, 1e4]), shift=st.sampled_from([0.0, 1e6]))
def test_slivers_points_and_huge_coordinates_have_their_closest_points(
    device: str, mesh: tuple[Float, Int], scale: float, shift: float
) -> None:
    positions, faces = mesh[0] * scale + shift, mesh[1]
    points = around(positions, 30)
    distance, _, nearest = WarpIndex(positions, faces, device=device).closest(points)
    tolerance = 1e-9 * (scale + shift)
    assert np.allclose(distance, brute_force(positions, faces, points), rtol=1e-9, atol=tolerance)
    assert np.allclose(np.linalg.norm(points - nearest, axis=1), distance, atol=tolerance)


@on_each_device
@settings(max_examples=150)
@given(mesh=meshes)
def test_rays_find_every_triangle_they_go_through_and_no_other(device: str, mesh: tuple[Float, Int]) -> None:
    positions, faces = mesh
    origins, directions = rays(positions + np.diag([1e-3] * 3)[:1], 30)
    a = positions[faces][None, :, 0]
    ab, ac = positions[faces][None, :, 1] - a, positions[faces][None, :, 2] - a
    normal = np.cross(ab, ac)
    along = (normal * directions[:, None]).sum(axis=2)
    flat = np.abs(along) < 1e-7 * np.linalg.norm(directions, axis=1)[:, None]
    distance = ((a - origins[:, None]) * normal).sum(axis=2) / np.where(flat, 1.0, along)
    foot = origins[:, None] + distance[..., None] * directions[:, None] - a
    squared = np.where(flat, 1.0, (normal**2).sum(axis=2))
    v = (np.cross(foot, ac) * normal).sum(axis=2) / squared
    w = (np.cross(ab, foot) * normal).sum(axis=2) / squared
    depth = np.minimum(np.minimum(v, w), np.minimum(1 - v - w, distance))  # below zero: beside it or behind
    sure = ((np.abs(depth) > 1e-6) & ~flat).all(axis=1)
    expected = np.where((depth > 0) & ~flat, distance, np.inf).min(axis=1)
    found, face = WarpIndex(positions, faces, device=device).first_hit(origins, directions)
    assert np.allclose(found[sure], expected[sure], rtol=1e-6)
    assert np.array_equal(face < 0, np.isinf(found))


@on_each_device
def test_rays_along_the_edges_between_triangles_do_not_slip_through(device: str) -> None:
    sheet = grid(7.0, 3.0, 70, 30)
    origins = sheet.positions[np.abs(sheet.positions[:, :2]).max(axis=1) < 1.4] + np.array([0.0, 0.0, 5.0])
    distance, _ = WarpIndex(sheet.positions, sheet.faces, device=device).first_hit(
        origins, np.tile([0, 0, -2.0], (len(origins), 1))
    )
    assert np.allclose(distance, 2.5)


@on_each_device
def test_long_thin_triangles_beside_small_ones_are_found(device: str) -> None:
    needle = box(30.0, 1e-4, 1e-7)
    both = join(moved(sphere(1.0, subdivisions=3), 0, 5, 0), needle)
    points = np.column_stack([np.linspace(-20, 20, 400), np.full(400, 1.0), np.zeros(400)])
    expected, _, _ = SpatialIndex(both.positions, both.faces).closest(points)
    assert np.abs(WarpIndex(both.positions, both.faces, device=device).closest(points)[0] - expected).max() < 1e-9


@on_each_device
def test_only_the_rows_that_count_answer_and_under_their_own_numbers(device: str) -> None:
    both = join(sphere(1.0, subdivisions=2), sphere(3.0, subdivisions=2))
    outer = np.arange(len(both.faces) // 2, len(both.faces))
    index = WarpIndex(both.positions, both.faces, outer, device=device)
    distance, face, _ = index.closest(np.zeros((1, 3)))
    assert distance[0] > 2.5
    assert face[0] in outer
    hit, face = index.first_hit(np.array([[0.1, 0.2, 0.0], [0, 0, 9]]), np.array([[0.0, 0, 1], [0, 0, 1]]))
    assert hit[0] > 2.5
    assert face[0] in outer
    assert face[1] == -1


@on_each_device
def test_no_question_no_answer_and_no_way_no_hit(device: str) -> None:
    cube = box(2.0, 2.0, 2.0)
    index, nothing = WarpIndex(cube.positions, cube.faces, device=device), np.empty((0, 3))
    assert [len(part) for part in index.closest(nothing)] == [0, 0, 0]
    assert [len(part) for part in index.first_hit(nothing, nothing)] == [0, 0]
    distance, face = index.first_hit(np.zeros((1, 3)), np.zeros((1, 3)))
    assert (distance[0], face[0]) == (np.inf, -1)


@on_each_device
def test_questions_from_far_away_lose_no_precision(device: str) -> None:
    sheet = grid(2.0, 2.0, 20, 20)
    index = WarpIndex(sheet.positions, sheet.faces, device=device)
    targets = np.random.default_rng(0).uniform(-0.999, 0.999, (200, 3)) * (1, 1, 0)
    directions = np.array([0.3, -0.2, -1.0]) + targets / 10
    origins = targets - directions * 1e6
    distance, face = index.first_hit(origins, directions)
    assert np.allclose(distance, 1e6, rtol=1e-9)
    assert on_face(sheet.positions, sheet.faces, face, targets).max() < 1e-8
    assert np.allclose(index.closest(targets + np.array([0, 0, 1e6]))[0], 1e6, rtol=1e-12)


@on_each_device
def test_a_model_is_marked_as_on_the_cpu(monkeypatch: pytest.MonkeyPatch, device: str) -> None:
    parameters = Parameters.model_validate({"text": "watermark", "evaluate": "geometry"})
    monkeypatch.setenv("MESHMARK_DEVICE", "cpu")
    expected = watermark(SPOT.read_bytes(), parameters, preview=False).report
    monkeypatch.setenv("MESHMARK_DEVICE", device)
    monkeypatch.setattr("core.analysis.analyse.spatial_index", partial(WarpIndex, device=device))
    found = watermark(SPOT.read_bytes(), parameters, preview=False).report
    assert (expected["engine"]["device"], found["engine"]["device"]) == ("cpu", device)
    assert abs(len(found["watermarks"]) - len(expected["watermarks"])) <= 1
    before, after = (report["metrics"]["watermark_quality"] for report in (expected, found))
    assert before["coverage"] > 0.9
    for name in ("coverage", "ray", "wps_area"):
        assert after[name] == pytest.approx(before[name], abs=0.02), name


def test_where_nothing_can_be_compiled_to_an_error_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    program = (
        "import numpy as np; from core.geometry.spatial_warp import WarpIndex;"
        "WarpIndex(np.eye(3), np.array([[0, 1, 2]]), device='cpu').closest(np.zeros((1, 3)))"
    )
    environment = os.environ | {"WARP_CACHE_PATH": os.fspath(tmp_path / "file" / "kernels")}
    run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    assert "device_unavailable: What is compiled for the device cannot be kept" in run.stderr
    assert "WARP_CACHE_PATH" in run.stderr
