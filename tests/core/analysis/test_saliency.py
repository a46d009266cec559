import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.stats import spearmanr

from core.analysis.saliency import SALIENCY, Saliency, SaliencyOptions, saliency
from core.arrays import Float
from core.budgets import DEFAULT_BUDGETS
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.gltf.scene import flatten
from core.lab.plain import Mesh
from tests.core.placement.shapes import box, boxes, cuboid, inside_out, join, moved, plane, rotation, sphere, surface

DATA = Path(__file__).parents[2] / "data"
MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", Path(__file__).parents[4] / "shared" / "meshes"))
REAL = [DATA / "spot.glb"] + [
    MESHES / name for name in ("elephant-paper.obj", "human-smpl.obj") if (MESHES / name).exists()
]


def read(path: Path) -> Surface:
    data = path.read_bytes()
    return flatten(document_of(admit(data, DEFAULT_BUDGETS), DEFAULT_BUDGETS)).surface


def agreement(one: Saliency, other: Saliency) -> float:
    """Rank correlation of two maps of the same shape, each point against the nearest one of the other."""
    _, nearest = cKDTree(other.points).query(one.points)
    return float(spearmanr(one.value, other.value[nearest]).statistic)


def halved(shape: Surface) -> Surface:
    """Every face cut into four at the middles of its edges."""
    a, b, c = (shape.positions[shape.faces[:, corner]] for corner in range(3))
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    corners = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    return Mesh(corners, np.arange(len(corners)).reshape(-1, 3)).surface()


def turned(profile: Float, around: int = 48) -> Surface:
    """What a lathe makes of a profile (P, 2) of radii and heights: pipes, limbs, heads on necks, about the Y axis."""
    radius, height = profile.T
    angle = np.arange(around) * 2 * np.pi / around
    rings = [
        np.outer(radius, np.sin(angle)),
        np.repeat(height[:, None], around, axis=1),
        np.outer(radius, np.cos(angle)),
    ]
    here = (np.arange(len(profile) - 1)[:, None] * around + np.arange(around)).ravel()
    beside = (np.arange(len(profile) - 1)[:, None] * around + (np.arange(around) + 1) % around).ravel()
    faces = [np.column_stack([here, beside, beside + around]), np.column_stack([here, beside + around, here + around])]
    return surface(np.stack(rings, axis=2).reshape(-1, 3), np.concatenate(faces))


def limb(radius: float, end: float | None = None) -> Surface:
    """A limb 24 long about the origin, open below and above, with ``radius`` below and ``end`` above."""
    return turned(np.array([[radius, -12], [radius if end is None else end, 12]]))


def figure(neck: float = 0.8, head: float = 1.6) -> Surface:
    """A limb with a ball on top of it, in one piece."""
    angle = np.linspace(np.pi - np.arcsin(neck / head), 0, 24)
    ball = np.column_stack([head * np.sin(angle), 12 + head * (np.cos(angle) - np.cos(angle[0]))])
    return turned(np.concatenate([[[neck, -12]], ball]))


def ripples(height: Float) -> Surface:
    """A sheet of 30 x 30 whose squares of 0.3 are moved up by ``height`` (101 x 101)."""
    flat = plane(30, 30, cells=100)
    return surface(flat.positions + np.column_stack([np.zeros((101**2, 2)), height.ravel()]), flat.faces)


STEP = np.linspace(-15, 15, 101)
GRAIN = np.random.default_rng(0).normal(size=(101, 101)) * 0.05


def test_the_corners_of_a_cube_are_salient_and_its_edges_and_faces_are_not() -> None:
    found = saliency(cuboid(30, 30, 30), seed=0)
    away = np.sort(15 - np.abs(found.points), axis=1)
    corner, edge = away[:, 2] < 0.5, (away[:, 1] < 0.2) & (away[:, 2] > 2)
    assert corner.any()
    assert found.salient[corner].all()
    assert edge.sum() > 100
    assert not found.salient[away[:, 2] > 2].any()
    assert found.value[away[:, 2] > 2].max() < 1e-6


@pytest.mark.parametrize(
    "shape",
    [limb(0.5), limb(1), limb(3), limb(1.5, 0.8), ripples(np.repeat(np.sin(2 * STEP)[:, None], 101, axis=1))],
    ids=["wire", "arm", "leg", "tapered limb", "corrugated sheet"],
)
def test_what_bends_in_one_way_only_is_not_salient(shape: Surface) -> None:
    found = saliency(join(shape, moved(sphere(0.7), shift=(20, 0, 0))), seed=0)
    knob = found.points[:, 0] > 18
    assert found.salient[knob].mean() > 0.9
    assert not found.salient[~knob].any()
    assert found.value[~knob].max() < 0.1


def test_a_head_is_salient_and_the_neck_below_it_is_not() -> None:
    found = saliency(figure(), seed=0)
    head, neck = found.points[:, 1] > 12.2, found.points[:, 1] < 10
    assert found.salient[head].all()
    assert not found.salient[neck].any()


@settings(max_examples=12)
@given(
    neck=st.floats(0.4, 2.5),
    wider=st.floats(1.3, 2),
    axis=st.tuples(*[st.floats(0.1, 1)] * 3),
    degrees=st.floats(0, 360),
)
def test_heads_are_salient_and_limbs_are_not_however_wide_and_whichever_way_they_point(
    neck: float, wider: float, axis: tuple[float, float, float], degrees: float
) -> None:
    turn = rotation(axis, degrees)
    found = saliency(moved(figure(neck, wider * neck), turn), seed=0)
    height = (found.points @ turn)[:, 1]
    assert found.salient[height > 12.5].mean() > 0.95
    assert not found.salient[height < 10].any()


@settings(max_examples=12)
@given(radius=st.floats(0.4, 3), x=st.floats(-10, 10), y=st.floats(-10, 10))
def test_a_knob_on_a_plain_body_is_salient_wherever_it_is(radius: float, x: float, y: float) -> None:
    found = saliency(join(plane(30, 30), moved(sphere(radius), shift=(x, y, 0))), seed=0)
    away = np.linalg.norm(found.points - [x, y, 0], axis=1)
    assert found.salient[(away < 1.01 * radius) & (found.points[:, 2] > 0.3 * radius)].mean() > 0.9
    assert not found.salient[away > radius + 1.7].any()


@pytest.mark.parametrize(
    "shape",
    [sphere(15), sphere(15, rings=200), sphere(15, rings=8), plane(30, 30), plane(1e-3, 1e-3), ripples(GRAIN), limb(1)],
    ids=["ball", "fine ball", "low-poly ball", "plane", "tiny plane", "rough plane", "limb"],
)
def test_nothing_is_salient_where_nothing_stands_out(shape: Surface) -> None:
    found = saliency(shape, seed=0)
    assert found.threshold == 1
    assert not found.salient.any()


@pytest.mark.parametrize(
    "path",
    [MESHES / name for name in ("ball-a.off", "glass-hurricane-candle-holder.glb") if (MESHES / name).exists()],
    ids=lambda path: path.stem,
)
def test_nothing_is_salient_on_a_ball_or_a_glass(path: Path) -> None:
    assert not saliency(read(path), seed=0).salient.any()


@pytest.mark.parametrize("shape", [sphere(15, rings=200), plane(30, 30), plane(1e-3, 1e-3), limb(1)])
def test_values_are_low_where_nothing_stands_out(shape: Surface) -> None:
    assert saliency(shape, seed=0).value.max() < 0.2


def test_nothing_is_salient_where_the_options_ask_for_more_contrast_than_there_is() -> None:
    shape = figure()
    assert saliency(shape, seed=0).salient.any()
    assert not saliency(shape, seed=0, options=SaliencyOptions(samples=5000, contrast=0.9)).salient.any()


def test_small_balls_all_alike_have_nothing_salient() -> None:
    balls = join(*(moved(sphere(2, rings=40), shift=(10 * number, 0, 0)) for number in range(3)))
    assert not saliency(balls, seed=0).salient.any()


def test_a_small_knob_on_a_large_plain_body_is_salient() -> None:
    found = saliency(join(plane(30, 30), moved(sphere(0.7), shift=(5, 0, 0.3))), seed=0)
    knob = np.linalg.norm(found.points - [5, 0, 0.3], axis=1) < 0.8
    assert 0 < knob.mean() < 0.01
    assert found.salient[knob].mean() > 0.9
    assert found.salient[~knob].mean() < 0.01
    assert found.threshold < 1


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_the_map_hardly_depends_on_tessellation(path: Path) -> None:
    shape = read(path)
    one, other = saliency(shape, seed=0), saliency(halved(shape), seed=0)
    assert agreement(one, other) > 0.97
    assert other.threshold == pytest.approx(one.threshold, abs=0.05)
    assert other.salient.mean() == pytest.approx(one.salient.mean(), abs=0.02)


def test_the_winding_of_faces_does_not_matter() -> None:
    shape = read(DATA / "spot.glb")
    flipped = np.arange(len(shape.faces))[:, None] % 2 == 1
    mixed = surface(shape.positions, np.where(flipped, shape.faces[:, ::-1], shape.faces))
    one, other = saliency(shape, seed=0), saliency(mixed, seed=0)
    assert agreement(one, other) > 0.95
    assert other.salient.mean() == pytest.approx(one.salient.mean(), abs=0.02)


def test_a_second_copy_of_a_sheet_changes_little() -> None:
    shape = read(DATA / "spot.glb")
    one, other = saliency(shape, seed=0), saliency(join(shape, inside_out(shape)), seed=0)
    assert agreement(one, other) > 0.93  # half as many samples on either side
    assert other.salient.mean() == pytest.approx(one.salient.mean(), abs=0.03)


def test_the_map_turns_with_the_asset() -> None:
    shape, turn = figure(), rotation((1, 2, 3), 40)
    one, other = saliency(shape, seed=0), saliency(moved(shape, turn), seed=0)
    assert other.points == pytest.approx(one.points @ turn.T)
    assert np.abs(other.value - one.value).mean() < 0.01


def test_the_same_seed_gives_the_same_map() -> None:
    one, other = saliency(cuboid(3, 2, 1), seed=5), saliency(cuboid(3, 2, 1), seed=5)
    assert one.points.shape == one.normals.shape == (SALIENCY.samples, 3)
    assert (one.value == other.value).all()
    assert one.threshold == other.threshold


def test_values_are_between_zero_and_one() -> None:
    value = saliency(cuboid(30, 1, 0.1), seed=0).value
    assert value.min() >= 0
    assert value.max() <= 1


def test_a_shape_without_area_is_refused() -> None:
    with pytest.raises(MeshmarkError) as caught:
        saliency(surface(np.zeros((3, 3)), np.array([[0, 1, 2]])), seed=0)
    assert caught.value.code is ErrorCode.NO_FACES


def under(saliency: Saliency, marks: Boxes) -> tuple[np.ndarray, np.ndarray]:
    return saliency.under(saliency.pairs_in_boxes(marks))


def hand_made() -> Saliency:
    """A sheet of points one unit apart that face +Z, salient at x > 0; the same 0.1 below, facing down, all salient."""
    x, y = np.meshgrid(np.arange(-9.5, 10), np.arange(-9.5, 10), indexing="ij")
    top = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    value = np.where(top[:, 0] > 0, 0.8, 0.2)
    return Saliency(
        points=np.concatenate([top, top - [0, 0, 0.1]]),
        normals=np.repeat([[0.0, 0, 1], [0, 0, -1]], x.size, axis=0),
        value=np.concatenate([value, np.ones(x.size)]),
        threshold=0.5,
        face=np.zeros(2 * x.size, dtype=np.int64),
    )


def test_what_lies_in_a_box_and_faces_it_is_averaged() -> None:
    marks = boxes(box((5, 0, 0), (4, 4, 1)), box((-5, 0, 0), (4, 4, 1)), box((1, 0, 0), (8, 4, 1)))
    mean, share = under(hand_made(), marks)
    assert mean.tolist() == pytest.approx([0.8, 0.2, (5 * 0.8 + 3 * 0.2) / 8])
    assert share.tolist() == pytest.approx([1, 0, 5 / 8])


def test_a_box_on_the_other_side_sees_that_side() -> None:
    down = box((-5, 0, -0.1), (4, 4, 1), axes=np.diag([-1.0, 1, -1]))
    assert under(hand_made(), down)[1][0] == 1


def test_a_box_smaller_than_the_samples_asks_the_nearest_that_face_it() -> None:
    marks = boxes(box((5, 0, 0), (0.2, 0.1, 0.1)), box((-5, 0, 0), (0.2, 0.1, 0.1)), box((5, 0, 0), (4, 4, 1)))
    mean, share = under(hand_made(), marks)
    assert mean.tolist() == pytest.approx([0.8, 0.2, 0.8])
    assert share.tolist() == [1, 0, 1]


def test_where_no_side_faces_the_box_the_nearest_points_count_either_way() -> None:
    shape = saliency(inside_out(cuboid(10, 10, 10)), seed=0)
    tip = np.array([[1, -1, 0], [1, 1, -2], [1, 1, 1]]) / np.sqrt([[2], [6], [3]])
    _, share = under(shape, boxes(box((0, 0, 5)), box((5, 5, 5), (0.2, 0.1, 0.1), axes=tip)))
    assert share.tolist() == [0, 1]


def test_no_boxes_have_no_saliency() -> None:
    none = Boxes.empty()
    assert [len(part) for part in under(hand_made(), none)] == [0, 0]
