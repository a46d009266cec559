"""Letters of a soft profile: what they do to the surface, and what they leave as it was."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.arrays import Float, Int
from core.choices import Profile
from core.embossing.emboss import Mark
from core.embossing.islands import letter_islands
from core.embossing.refusal import Refusal
from core.embossing.soft import EASE, STILL
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.geometry.triangles import flat_normals
from core.gltf.edit import Kind, SurfaceEdit
from tests.core.embossing.bench import TEXT, Bench, box_at
from tests.core.shapes import box, edge_counts, grid, join, moved, sphere, surface

SOFT = letter_islands(TEXT, Profile.SOFT)
assert SOFT.soft is not None
FIELD = SOFT.soft
RELIEF = 0.08  # of letters in a text four wide
ON_SPHERE = box_at(center=(0.0, 0.0, 10.0), thickness=0.6)


def _embossed(ground: Surface, at: Boxes, relief: float = RELIEF) -> tuple[Bench, SurfaceEdit]:
    bench = Bench(ground)
    assert isinstance(bench.emboss(at, relief, SOFT), Mark)
    return bench, bench.edit()


def _rolling(columns: int, rows: int, depth: float, waves: float, slant: float) -> Surface:
    flat = grid(10.0, 4.0, columns, rows)
    x, y, z = flat.positions.T
    return surface(np.column_stack([x, y, z + depth * np.sin(waves * x) * np.cos(waves * y) + slant * y]), flat.faces)


@settings(max_examples=12)
@given(
    columns=st.integers(1, 40),
    rows=st.integers(1, 20),
    depth=st.floats(0.0, 0.1),
    waves=st.floats(0.1, 1.5),
    turn=st.floats(-0.6, 0.6),
    right=st.floats(-2.4, 2.4),
    relief=st.sampled_from([RELIEF, -RELIEF, 0.02]),
)
def test_whatever_the_ground_is_divided_into_a_mark_fits_its_hole_edge_by_edge(
    columns: int, rows: int, depth: float, waves: float, turn: float, right: float, relief: float
) -> None:
    ground = _rolling(columns, rows, depth, waves, 0.05)
    bench = Bench(ground)
    along = (float(np.cos(turn)), float(np.sin(turn)), 0.0)
    outcome = bench.emboss(box_at(center=(right, 0.0, 0.0), right=along, thickness=1.0), relief, SOFT)
    edit = bench.edit()
    before = ground.weld[ground.faces]
    assert edge_counts(bench.faces()) == edge_counts(before)
    if isinstance(outcome, Refusal):
        assert edit.keep.all()
        return
    kept = _sides(before[edit.keep])
    assert _sides(before) & kept == kept  # nobody touched what is kept
    known = edit.vertex < len(bench.mesh.points) - len(np.unique(edit.vertex[edit.vertex > ground.weld.max()]))
    assert np.array_equal(edit.position[known], bench.mesh.points[edit.vertex[known]])
    # Letters rise along the ground's normal: on slanted ground a steep foot leans over the horizon.
    middle = edit.position.reshape(-1, 3, 3).mean(axis=1)
    _, under, _ = SpatialIndex(ground.positions, ground.faces).closest(middle)
    up = np.einsum("ti,ti->t", flat_normals(edit.position), ground.normals[under])
    assert (up > 0).mean() > 0.999  # nothing is turned over


def _sides(faces: Int) -> set[tuple[int, int]]:
    return {(int(a), int(b)) for face in faces.tolist() for a, b in zip(face, face[1:] + face[:1], strict=True)}


def test_a_closed_asset_stays_closed_and_the_ground_outside_the_mark_stays_to_the_bit() -> None:
    bench, edit = _embossed(sphere(10.0), ON_SPHERE)
    assert edge_counts(bench.faces()) == (0, 0)
    untouched = edit.original >= 0
    assert untouched.any()
    assert np.array_equal(edit.position[untouched], bench.surface.positions[edit.original[untouched]])


@pytest.mark.parametrize("ground", [box(10.0, 10.0, 10.0), moved(grid(10.0, 4.0, 200, 80), 0.0, 0.0, 5.0)])
def test_nine_letters_take_at_most_six_thousand_triangles_whatever_the_ground(ground: Surface) -> None:
    bench = Bench(ground)
    mark = bench.emboss(box_at(center=(0.0, 0.0, 5.0)), RELIEF, SOFT)
    assert isinstance(mark, Mark)
    assert mark.cut == "delaunay"
    assert 1000 < mark.faces < 6000


@pytest.mark.parametrize("relief", [RELIEF, -RELIEF])
def test_the_surface_is_displaced_by_the_height_field(relief: float) -> None:
    _, edit = _embossed(grid(10.0, 4.0, 20, 8), box_at(), relief)
    at = edit.position.reshape(-1, 3)
    height = FIELD.at(at[:, :2] / 4.0)
    still = (at[:, 2] == 0) & (np.abs(height) < STILL)  # where the trench runs out
    assert np.allclose(at[~still, 2], relief * height[~still], atol=1e-9)
    # Between the vertices too, where the triangles bridge it.
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(3), (len(edit.position), 4))
    points = np.einsum("mwk,mki->mwi", weights, edit.position).reshape(-1, 3)
    error = np.abs(points[:, 2] / relief - FIELD.at(points[:, :2] / 4.0))
    area = np.repeat(np.linalg.norm(np.cross(*(edit.position[:, 1:] - edit.position[:, :1]).swapaxes(0, 1)), axis=1), 4)
    near = np.abs(FIELD.at(points[:, :2] / 4.0)) > 0.01
    assert np.average(error[near], weights=area[near]) < 0.04


def test_letters_stand_out_and_a_shallow_trench_runs_round_them() -> None:
    _, edit = _embossed(grid(10.0, 4.0, 20, 8), box_at())
    letters, trench = (edit.position[edit.kind == kind][..., 2] / RELIEF for kind in (Kind.CAP, Kind.TRENCH))
    assert 0.9 < letters.max() < 1.1
    assert -0.4 < trench.min() < -0.1
    assert set(np.unique(edit.kind)) <= {Kind.SURFACE, Kind.CAP, Kind.TRENCH}


def test_the_faces_of_letters_are_exactly_their_shapes() -> None:
    _, edit = _embossed(grid(10.0, 4.0, 20, 8), box_at())
    letters = edit.position[edit.kind == Kind.CAP]
    u, v = letters[:, 1, :2] - letters[:, 0, :2], letters[:, 2, :2] - letters[:, 0, :2]
    area = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum() / 2
    assert area == pytest.approx(16.0 * sum(island.area() for island in SOFT.islands), rel=1e-6)


def test_there_is_no_edge_at_the_foot_of_a_letter() -> None:
    _, edit = _embossed(grid(10.0, 4.0, 20, 8), box_at())
    rim = edit.tilt[(np.abs(edit.position[..., 2]) < 1e-6) & (edit.tilt != 0).any(axis=2)]
    assert np.linalg.norm(rim, axis=1).max(initial=0.0) < np.tan(np.radians(10))


def test_normals_follow_the_slopes_of_the_field() -> None:
    _, edit = _embossed(grid(10.0, 4.0, 20, 8), box_at())
    normal = np.array([0.0, 0.0, 1.0]) + edit.tilt
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    along = np.einsum("mi,mki->mk", flat_normals(edit.position), normal)
    area = np.linalg.norm(np.cross(*(edit.position[:, 1:] - edit.position[:, :1]).swapaxes(0, 1)), axis=1)
    assert np.average(along.min(axis=1), weights=area) > 0.92


def test_letters_by_the_edge_of_a_sheet_are_eased_and_the_edge_stays() -> None:
    aspect = TEXT.aspect
    ground = grid(4.0 * 1.04, 4.0 * (aspect + 0.04), 40, 8)
    bench, edit = _embossed(ground, box_at())
    assert edge_counts(bench.faces()) == edge_counts(ground.weld[ground.faces])
    low = np.abs(edit.position[..., 2])[np.abs(edit.position[..., 1]) > 2.0 * (aspect + 0.04) - 0.01]
    assert low.max() < 0.2 * RELIEF
    assert 4.0 * EASE * FIELD.slope < 0.1


def test_attributes_of_both_sides_of_a_seam_stay_apart() -> None:
    left, right = moved(grid(5.0, 4.0, 20, 16), -2.5, 0.0, 0.0), moved(grid(5.0, 4.0, 20, 16), 2.5, 0.0, 0.0)
    _, edit = _embossed(join(left, right), box_at())
    half = len(left.faces)
    side = edit.corner_face >= half
    assert (side == side[:, :1]).all()
    middle = edit.position.mean(axis=1)[:, 0]
    assert (side[:, 0] == (middle > 0))[np.abs(middle) > 1e-9].all()


def test_what_is_interpolated_in_the_ground_is_what_was_there() -> None:
    ground = grid(10.0, 4.0, 40, 16)
    _, edit = _embossed(ground, box_at())
    feet = np.einsum("mck,mcki->mci", edit.barycentric, ground.positions[ground.faces[edit.corner_face]])
    assert np.allclose(feet[..., :2], edit.position[..., :2], atol=1e-9)


def test_a_thin_sheet_of_two_sides_gets_no_trench_that_would_come_through_its_back() -> None:
    front, gap = grid(10.0, 4.0, 20, 8), 0.01
    back = surface(front.positions - [0.0, 0.0, gap], front.faces[:, ::-1])
    bench = Bench(join(front, back))
    assert isinstance(bench.emboss(box_at(), RELIEF, SOFT), Mark)
    edit = bench.edit()
    assert edit.position[..., 2].min() == 0.0
    assert edit.position[..., 2].max() > 0.9 * RELIEF


def test_letters_under_a_shelf_and_sunken_ones_in_a_thin_wall_are_refused() -> None:
    shelf = moved(grid(10.0, 4.0, 20, 8), 0.0, 0.0, RELIEF * 1.2)
    bench = Bench(join(grid(10.0, 4.0, 20, 8), shelf))
    assert isinstance(bench.emboss(box_at(thickness=0.05), RELIEF, SOFT), Refusal)
    thin = Bench(join(grid(10.0, 4.0, 20, 8), surface(*_turned(moved(grid(10.0, 4.0, 20, 8), 0.0, 0.0, -0.05)))))
    assert thin.emboss(box_at(), -RELIEF, SOFT) is Refusal.THIN_WALL
    assert bench.edit().keep.all()
    assert thin.edit().keep.all()


def _turned(part: Surface) -> tuple[Float, Int]:
    return part.positions, part.faces[:, ::-1]


def test_the_ground_of_a_mark_is_not_cut_again() -> None:
    bench = Bench(grid(10.0, 4.0, 20, 8))
    assert isinstance(bench.emboss(box_at(), RELIEF, SOFT), Mark)
    assert isinstance(bench.emboss(box_at(center=(0.05, 0.05, 0.0)), RELIEF, SOFT), Refusal)
    assert isinstance(bench.emboss(box_at(center=(0.0, 1.3, 0.0), width=3.0), RELIEF, SOFT), Mark)
    assert edge_counts(bench.faces()) == edge_counts(bench.surface.weld[bench.surface.faces])


def test_the_same_letters_give_the_same_triangles() -> None:
    (_, once), (_, again) = (_embossed(sphere(10.0), ON_SPHERE) for _ in range(2))
    assert np.array_equal(once.position, again.position)
    assert np.array_equal(once.vertex, again.vertex)


def test_a_face_of_two_triangles_carries_as_many_marks_as_it_has_room_for() -> None:
    bench = Bench(box(10.0, 10.0, 10.0))
    places = [(x, y, 5.0) for x in (-2.4, 2.4) for y in (-4.0, -2.0, 0.0, 2.0, 4.0)]
    marks = [bench.emboss(box_at(center=place), RELIEF, SOFT) for place in places]
    assert all(isinstance(mark, Mark) for mark in marks), marks
    assert edge_counts(bench.faces()) == (0, 0)
