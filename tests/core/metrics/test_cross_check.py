"""The metrics of real watermarked assets against second implementations, by other libraries or written plainly."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh

from core.arrays import Bool, Float
from core.budgets import DEFAULT_BUDGETS
from core.choices import Evaluate
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.geometry.directions import fibonacci_directions, view_directions
from core.geometry.sampling import sample
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.gltf.scene import flatten, scene_of
from core.lab.plain import plain
from core.metrics import smse as smse_module
from core.metrics.coverage import coverage
from core.metrics.ipe import ipe
from core.metrics.ray import ray
from core.metrics.ray_origins import above_letters, top_face
from core.metrics.smse import smse
from core.metrics.topology import topology
from core.metrics.wps import wps
from core.parameters import Parameters
from core.pipeline import watermark
from tests.core.placement.shapes import cuboid, index_of, join, moved, sphere

MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", Path(__file__).parents[4] / "shared" / "meshes"))
ASSETS = [Path(__file__).parents[2] / "data" / "spot.glb"] + [
    MESHES / name for name in ("fox.glb", "airplane-textured.zip") if (MESHES / name).exists()
]


@dataclass(frozen=True, eq=False)
class Pair:
    original: Surface
    watermarked: Surface
    boxes: Boxes
    relief: Float


@pytest.fixture(scope="module", params=ASSETS, ids=lambda path: path.stem)
def pair(request: pytest.FixtureRequest) -> Pair:
    data = request.param.read_bytes()
    original = flatten(document_of(admit(data, DEFAULT_BUDGETS), DEFAULT_BUDGETS)).surface
    result = watermark(data, Parameters(text="Mark", count=6, evaluate=Evaluate.NONE), preview=False)
    marks = result.report["watermarks"]
    boxes = Boxes(
        np.array([(np.array(mark["center"]) - original.offset) * original.scale for mark in marks]),
        np.array([[mark["right"], mark["up"], mark["normal"]] for mark in marks]),
        np.array([mark["size"] for mark in marks]) * original.scale,
    )
    written = scene_of(result.model).surface.in_frame_of(original)
    return Pair(original, written, boxes, np.array([mark["relief"] for mark in marks]) * original.scale)


def distance_to_all(points: Float, shape: Surface) -> Float:
    """(N,) distance of each point to the nearest of all triangles, each asked in turn by trimesh."""
    triangles = shape.positions[shape.faces]
    result = []
    for point in points:
        repeated = np.broadcast_to(point, (len(triangles), 3))
        nearest = trimesh.triangles.closest_point(triangles, repeated)  # type: ignore[no-untyped-call]
        result.append(np.linalg.norm(nearest - point, axis=1).min())
    return np.array(result)


def blocked(origin: Float, direction: Float, shape: Surface) -> Bool:
    """(N,) whether a ray from each origin meets any triangle (Moeller, Trumbore 1997)."""
    a, b, c = (shape.positions[shape.faces[:, corner]] for corner in range(3))
    one, two = b - a, c - a
    cross = np.cross(direction, two)
    determinant = (one * cross).sum(axis=1)
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=np.abs(determinant) > 1e-14)
    result = []
    for point in origin:
        away = point - a
        u = (away * cross).sum(axis=1) * inverse
        turned = np.cross(away, one)
        v = turned @ direction * inverse
        along = (two * turned).sum(axis=1) * inverse
        result.append(((inverse != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (along > 0)).any())
    return np.array(result)


def plain_ray(boxes: Boxes, points: Float, shape: Surface, directions: Float) -> tuple[float, float]:
    """Ray and coverage, one view and one mark at a time."""
    scores, covered = [], []
    for direction in directions:
        votes = []
        for number in range(len(boxes)):
            to_eye = 75 * direction - boxes.center[number]
            if np.degrees(np.arccos(boxes.axes[number, 2] @ to_eye / np.linalg.norm(to_eye))) <= 45:
                votes.append(
                    not any(blocked(point[None], 75 * direction - point, shape)[0] for point in points[number])
                )
        scores.append(float(np.mean(votes)) if votes else 0.0)
        covered.append(any(votes))
    return float(np.mean(scores)), float(np.mean(covered))


def plain_wps(original: Surface, boxes: Boxes) -> list[float]:
    """The procedure of the supplement, step by step."""
    scores = []
    for center, (right, up, normal), size in zip(boxes.center, boxes.axes, boxes.size, strict=True):
        offset = original.positions - center
        vertices_in = [
            number
            for number, along in enumerate(np.stack([offset @ right, offset @ up, offset @ normal], axis=1))
            if (2 * np.abs(along) <= size).all()
        ]
        inside = set(vertices_in)
        faces_in = [face for face in original.faces.tolist() if inside.issuperset(face)]
        area = 0.0
        for face in faces_in:
            a, b, c = original.positions[face]
            # The area vector of a triangle, along the normal of the front, is its projected area.
            area += max(0.0, float(np.cross(b - a, c - a) @ normal) / 2)
        scores.append(min(area / (size[0] * size[1]), 1.0))
    return scores


def test_smse_agrees_with_trimesh_asked_for_every_triangle(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smse_module, "SAMPLES", 1600)
    found = smse(index_of(pair.original), pair.watermarked, np.random.default_rng(2))
    points, _ = sample(pair.watermarked, 1600, np.random.default_rng(2))
    expected = distance_to_all(points, pair.original)
    assert expected.max() > pair.relief.min() / 2  # some samples lie on letters
    assert found == pytest.approx((expected.mean(), (expected**2).mean()), abs=1e-9)


def test_ray_agrees_with_every_ray_against_every_triangle(pair: Pair) -> None:
    index = SpatialIndex(pair.watermarked.positions, pair.watermarked.faces)
    directions, _ = view_directions()
    letters = above_letters(pair.original, index_of(pair.original), pair.boxes, pair.relief)[:, ::21]
    top = top_face(pair.boxes)[:, ::21]
    for points in (letters, top):
        assert ray(pair.boxes, points, index) == plain_ray(pair.boxes, points, pair.watermarked, directions)[0]


def test_ray_and_coverage_agree_among_many_obstacles() -> None:
    rng = np.random.default_rng(4)
    body = sphere(6, rings=16)
    rocks = [moved(sphere(0.5, rings=4), shift=tuple(7.5 * way)) for way in fibonacci_directions(40)]
    asset = join(body, cuboid(14, 0.3, 3), *rocks)
    normal = fibonacci_directions(14)
    right = np.cross(rng.normal(size=(14, 3)), normal)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    axes = np.stack([right, np.cross(normal, right), normal], axis=1)
    marks = Boxes(6.05 * normal, axes, np.tile([2.0, 0.6, 0.5], (14, 1)))
    points = top_face(marks)[:, ::5]
    expected, _ = plain_ray(marks, points, asset, view_directions()[0])
    _, covered = plain_ray(marks, points, asset, fibonacci_directions(200))
    assert 0.1 < expected < 0.9
    assert ray(marks, points, index_of(asset)) == pytest.approx(expected)
    assert coverage(marks, points, index_of(asset)) == pytest.approx(covered)


def test_ipe_agrees_with_the_parts_that_trimesh_splits_off(pair: Pair) -> None:
    def parts(shape: Surface) -> int:
        mesh = plain(shape)
        whole = trimesh.Trimesh(mesh.positions, mesh.faces, process=False)
        return len(whole.split(only_watertight=False, adjacency=whole.face_adjacency))

    floating = join(
        pair.watermarked, moved(cuboid(1, 1, 1), shift=(40, 0, 0)), moved(cuboid(2, 1, 1), shift=(50, 0, 0))
    )
    for marked in (pair.watermarked, floating):
        assert ipe(pair.original, marked) == abs(parts(marked) - parts(pair.original))
    assert topology(floating).components == topology(pair.watermarked).components + 2


def test_wps_agrees_with_the_supplement_step_by_step(pair: Pair) -> None:
    larger = Boxes(pair.boxes.center, pair.boxes.axes, pair.boxes.size * [3, 8, 3])
    for marks in (pair.boxes, larger):
        assert wps(pair.original, marks).tolist() == pytest.approx(plain_wps(pair.original, marks))
    assert wps(pair.original, larger).max() > 0.1
