"""What a customer may count on after a watermark went in, and what happens where it cannot."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.arrays import Float, Int
from core.artwork.outline import text_artwork
from core.embossing import emboss as module
from core.embossing.cut_arrange import arrange
from core.embossing.cut_split import split
from core.embossing.emboss import SLACK, EmbossOptions, Mark, emboss
from core.embossing.islands import letter_islands
from core.embossing.lift import folded
from core.embossing.refusal import Refusal
from core.geometry.surface import Surface
from core.gltf.edit import Kind
from tests.core.embossing.bench import LETTERS, TEXT, Bench, box_at
from tests.core.shapes import box, edge_counts, grid, join, moved, sphere, surface

LETTERS_AREA = sum(island.area() for island in LETTERS.islands)  # in square text widths
ON_SPHERE = box_at(center=(0.0, 0.0, 10.0), thickness=0.6)


def _seen_from_above(triangles: Float) -> Float:
    """(M,) areas of triangles (M, 3, 3) projected along z, negative where they look down."""
    u, v = triangles[:, 1, :2] - triangles[:, 0, :2], triangles[:, 2, :2] - triangles[:, 0, :2]
    return np.asarray((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2)


def test_a_closed_asset_stays_closed() -> None:
    bench = Bench(sphere(10.0))
    assert isinstance(bench.emboss(ON_SPHERE), Mark)
    assert edge_counts(bench.faces()) == (0, 0)


def test_an_open_sheet_keeps_its_open_edges_and_gains_none() -> None:
    bench = Bench(grid(10.0, 4.0, 20, 8))
    assert isinstance(bench.emboss(box_at()), Mark)
    assert edge_counts(bench.faces()) == edge_counts(bench.surface.weld[bench.surface.faces])


def test_twelve_triangles_are_enough() -> None:
    bench = Bench(box(10.0, 10.0, 10.0))
    assert isinstance(bench.emboss(box_at(center=(0.0, 0.0, 5.0))), Mark)
    assert edge_counts(bench.faces()) == (0, 0)


def test_letters_are_cut_where_a_shift_of_the_options_moves_them() -> None:
    bench, start = Bench(box(10.0, 10.0, 10.0)), box_at(center=(0.0, 0.0, 5.0))
    mark = emboss(bench.mesh, start, LETTERS, 0.2, bench.index, EmbossOptions(shifts=((0.5, -0.25),)))
    assert isinstance(mark, Mark)
    assert mark.box.center[0] == pytest.approx([0.5 * start.size[0, 1], -0.25 * start.size[0, 1], 5.0])


def test_all_letters_stand_at_exactly_the_relief() -> None:
    bench = Bench(sphere(10.0))
    bench.emboss(ON_SPHERE, relief=0.2)
    edit = bench.edit()
    tops = edit.position[edit.kind == Kind.CAP].reshape(-1, 3)
    distance, _, _ = bench.index.closest(tops)
    assert np.allclose(distance, 0.2, atol=1e-9)
    assert np.all(np.linalg.norm(tops, axis=1) > 10.0)


def test_sunken_letters_lie_exactly_the_relief_below() -> None:
    bench = Bench(sphere(10.0))
    assert isinstance(bench.emboss(ON_SPHERE, relief=-0.2), Mark)
    edit = bench.edit()
    tops = edit.position[edit.kind == Kind.CAP].reshape(-1, 3)
    distance, _, _ = bench.index.closest(tops)
    assert np.allclose(distance, 0.2, atol=1e-9)
    assert np.all(np.linalg.norm(tops, axis=1) < 10.0)
    assert edge_counts(bench.faces()) == (0, 0)


@pytest.mark.parametrize("relief", [0.2, -0.2])
def test_the_bounds_of_a_mark_hold_its_letters_and_hardly_more(relief: float) -> None:
    bench = Bench(sphere(10.0))
    mark = bench.emboss(ON_SPHERE, relief=relief)
    assert isinstance(mark, Mark)
    edit = bench.edit()
    letters = edit.position[edit.kind != Kind.SURFACE].reshape(-1, 3)
    beyond = np.abs(mark.bounds.to_local(0, letters)) - mark.bounds.size[0] / 2
    assert beyond[:, 2].max() == pytest.approx(-SLACK * abs(relief))
    assert mark.bounds.size[0, 2] < mark.box.size[0, 2]


def test_no_letter_is_lost() -> None:
    bench = Bench(grid(10.0, 4.0, 50, 20))
    bench.emboss(box_at())
    edit = bench.edit()
    wanted = 16.0 * LETTERS_AREA
    assert _seen_from_above(edit.position[edit.kind != Kind.SURFACE]).sum() == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize("relief", [0.2, -0.2])
def test_walls_lean_so_that_they_are_seen_from_straight_ahead(relief: float) -> None:
    bench = Bench(grid(10.0, 4.0, 50, 20))
    bench.emboss(box_at(), relief)
    edit = bench.edit()
    walls = _seen_from_above(edit.position[edit.kind == Kind.WALL])
    letters = 16.0 * LETTERS_AREA
    assert walls.min() > -1e-6 * letters
    assert walls.sum() > 0.4 * letters
    assert _seen_from_above(edit.position[edit.kind == Kind.CAP]).min() > -1e-6 * letters


@pytest.mark.parametrize("bend", [0.15, -0.15])
@pytest.mark.parametrize("relief", [0.05, -0.05])
def test_walls_lean_on_faceted_ground_too(bend: float, relief: float) -> None:
    flat = grid(10.0, 4.0, 8, 4)
    bent = flat.positions + np.abs(flat.positions[:, :1]) * np.array([0.0, 0.0, bend])
    bench = Bench(surface(bent, flat.faces))
    bench.emboss(box_at(center=(0.0, 0.0, 0.1 * np.sign(bend)), thickness=1.0), relief)
    edit = bench.edit()
    assert _seen_from_above(edit.position[edit.kind == Kind.WALL]).sum() > 0.05 * 16.0 * LETTERS_AREA


@pytest.mark.parametrize("relief", [0.2, -0.2])
def test_only_the_letter_whose_leaning_walls_would_meet_something_has_upright_ones(relief: float) -> None:
    sheet, place = grid(10.0, 4.0, 50, 20), box_at(thickness=0.3)
    clean = Bench(sheet)
    clean.emboss(place, relief)
    leaning = clean.edit().position[clean.edit().kind == Kind.CAP]
    # A speck in the way of one corner of the first letter, beside the outline that its upright walls have.
    corner = leaning.reshape(-1, 3)[leaning[..., 0].argmin()]
    speck = 0.002 * np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]) + corner * [1, 1, 1.3]
    bench = Bench(join(sheet, surface(speck, np.array([[0, 1, 2]]))))
    assert isinstance(bench.emboss(place, relief), Mark)
    tops = bench.edit().position[bench.edit().kind == Kind.CAP]
    first = 16.0 * min(LETTERS.islands, key=lambda island: island.bounds()[0]).area()
    grown = _seen_from_above(tops).sum() - _seen_from_above(leaning).sum()
    assert 0.3 * first < grown < 0.6 * first


def test_where_the_surface_has_no_room_for_leaning_walls_they_are_upright(monkeypatch: pytest.MonkeyPatch) -> None:
    def fussy(tops: Float, triangles: Int, normal: Float) -> bool:
        corners = tops[triangles]
        return folded(tops, triangles, normal) or bool(_seen_from_above(corners).sum() < 0.8 * 16 * LETTERS_AREA)

    monkeypatch.setattr("core.embossing.emboss.folded", fussy)
    bench = Bench(grid(10.0, 4.0, 50, 20))
    assert isinstance(bench.emboss(box_at()), Mark)
    edit = bench.edit()
    assert _seen_from_above(edit.position[edit.kind == Kind.CAP]).sum() == pytest.approx(16 * LETTERS_AREA, rel=1e-6)
    assert edge_counts(bench.faces()) == edge_counts(bench.surface.weld[bench.surface.faces])


def test_untouched_faces_are_kept_and_only_faces_under_the_text_go() -> None:
    bench = Bench(grid(30.0, 30.0, 60, 60))
    bench.emboss(box_at())
    gone = bench.surface.positions[bench.surface.faces[~bench.edit().keep]]
    assert len(gone) > 0
    assert np.all(np.abs(gone[..., 0]) <= 2.0 + 0.6)
    assert np.all(np.abs(gone[..., 1]) <= 2.0 * TEXT.aspect + 0.6)


def test_the_sheet_around_the_letters_still_covers_the_same_area() -> None:
    bench = Bench(grid(10.0, 4.0, 20, 8))
    bench.emboss(box_at())
    edit = bench.edit()
    kept = bench.surface.areas[edit.keep].sum()
    assert kept + _seen_from_above(edit.position).sum() == pytest.approx(40.0, rel=1e-9)


def test_walls_of_raised_letters_face_away_from_the_letters() -> None:
    bench = Bench(grid(10.0, 4.0, 20, 8))
    bench.emboss(box_at(), relief=0.2)
    edit = bench.edit()
    # A closed-off volume: letters on their foot print. The divergence theorem gives its size, which is that of a
    # pyramid's stump between the areas of feet and tops.
    parts = edit.position[edit.kind != Kind.SURFACE]
    volume = np.einsum("fi,fi->f", parts[:, 0], np.cross(parts[:, 1], parts[:, 2])).sum() / 6
    feet = _seen_from_above(parts).sum()
    tops = _seen_from_above(edit.position[edit.kind == Kind.CAP]).sum()
    assert volume == pytest.approx(0.2 * (feet + np.sqrt(feet * tops) + tops) / 3, rel=0.02)


def test_a_text_over_the_edge_of_the_sheet_is_refused_and_changes_nothing() -> None:
    bench = Bench(grid(10.0, 4.0, 20, 8))
    assert bench.emboss(box_at(center=(4.0, 0.0, 0.0))) is Refusal.NOT_WHOLE
    assert bench.edit().keep.all()
    assert len(bench.edit().vertex) == 0


def test_a_text_across_a_hole_is_refused() -> None:
    sheet = grid(10.0, 4.0, 40, 16)
    center = sheet.positions[sheet.faces].mean(axis=1)
    in_w = np.linalg.norm(center[:, :2] - [-1.8, 0.0], axis=1) < 0.2
    bench = Bench(surface(sheet.positions, sheet.faces[~in_w]))
    assert bench.emboss(box_at()) is Refusal.NOT_WHOLE


def test_a_text_over_the_edge_of_a_box_is_refused() -> None:
    assert Bench(box(10.0, 10.0, 10.0)).emboss(box_at(center=(4.0, 0.0, 5.0))) is Refusal.NOT_WHOLE


def test_an_edge_with_three_faces_under_the_text_is_refused_and_beside_it_is_fine() -> None:
    sheet = grid(10.0, 4.0, 20, 8)
    fin = np.array([[0.0, -2.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -3.0]])
    middle = np.flatnonzero(np.abs(sheet.positions[:, 0]) < 1e-9)
    along = middle[np.argsort(sheet.positions[middle, 1])]
    faces = np.array([[a, b, len(sheet.positions) + 2] for a, b in pairwise(along.tolist())])
    bench = Bench(surface(np.concatenate([sheet.positions, fin]), np.concatenate([sheet.faces, faces])))
    before = edge_counts(bench.surface.weld[bench.surface.faces])
    assert before[1] == 8
    assert bench.emboss(box_at()) is Refusal.NOT_WHOLE
    assert isinstance(bench.emboss(box_at(center=(2.6, 0.0, 0.0), width=3.0)), Mark)
    assert edge_counts(bench.faces()) == before


def test_letters_may_stand_on_several_parts_when_none_is_cut() -> None:
    text = text_artwork("i i")
    letters = letter_islands(text)
    left, right = moved(grid(2.0, 4.0, 4, 8), -1.005, 0.0, 0.0), moved(grid(2.0, 4.0, 4, 8), 1.005, 0.0, 0.0)
    bench = Bench(join(left, right))
    place = box_at(width=1.0, aspect=text.aspect)
    assert isinstance(bench.emboss(place, letters=letters), Mark)
    assert edge_counts(bench.faces()) == edge_counts(bench.surface.weld[bench.surface.faces])


def test_another_surface_right_above_the_letters_is_refused() -> None:
    lid = moved(grid(10.0, 4.0, 20, 8), 0.0, 0.0, 0.1)
    bench = Bench(join(grid(10.0, 4.0, 20, 8), lid))
    below = box_at(thickness=0.1)
    assert bench.emboss(below) is Refusal.SECOND_LAYER
    assert isinstance(bench.emboss(box_at(center=(0.0, 0.0, 0.1))), Mark)


def test_of_two_layers_in_the_box_the_upper_one_gets_the_text() -> None:
    lid = moved(grid(10.0, 4.0, 20, 8), 0.0, 0.0, 0.2)
    bench = Bench(join(grid(10.0, 4.0, 20, 8), lid))
    assert isinstance(bench.emboss(box_at(thickness=0.6)), Mark)
    edit = bench.edit()
    assert np.all(edit.source_face >= len(bench.surface.faces) // 2)


@pytest.mark.parametrize("thickness", [0.2, 0.05, 0.01, 0.001])
def test_sunken_letters_do_not_come_through_a_plate_however_thin(thickness: float) -> None:
    plate = Bench(box(10.0, 4.0, thickness))
    top = box_at(center=(0.0, 0.0, thickness / 2), thickness=0.0005)
    assert plate.emboss(top, relief=-0.25) is Refusal.THIN_WALL
    assert isinstance(plate.emboss(top, relief=-thickness / 2), Mark)


def test_two_watermarks_on_one_face_both_stand() -> None:
    bench = Bench(box(10.0, 10.0, 10.0))
    assert isinstance(bench.emboss(box_at(center=(0.0, 2.0, 5.0))), Mark)
    assert isinstance(bench.emboss(box_at(center=(0.0, -2.0, 5.0))), Mark)
    assert edge_counts(bench.faces()) == (0, 0)


def test_a_watermark_never_goes_on_top_of_another() -> None:
    bench = Bench(box(10.0, 10.0, 10.0))
    assert isinstance(bench.emboss(box_at(center=(0.0, 0.0, 5.0))), Mark)
    assert bench.emboss(box_at(center=(0.0, 0.0, 5.0))) is Refusal.NOT_WHOLE


def test_outlines_that_coincide_with_edges_of_the_mesh_are_cut_all_the_same() -> None:
    # The foot of the letters lies exactly on a row of edges.
    text = text_artwork("HILT")
    sheet = grid(8.0, 8.0, 8, 8)
    bench = Bench(sheet)
    place = box_at(center=(0.0, 2.0 * text.aspect, 0.0), width=4.0, aspect=text.aspect)
    assert isinstance(bench.emboss(place, letters=letter_islands(text)), Mark)
    assert edge_counts(bench.faces()) == edge_counts(sheet.weld[sheet.faces])


@pytest.mark.parametrize("cut", [split, arrange])
def test_either_way_of_cutting_gives_the_same_letters(cut: module.Cut, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CUTS", (("only", cut),))
    bench = Bench(sphere(10.0))
    assert isinstance(bench.emboss(ON_SPHERE), Mark)
    edit = bench.edit()
    letters = _seen_from_above(edit.position[edit.kind != Kind.SURFACE]).sum()
    assert letters == pytest.approx(16.0 * LETTERS_AREA, rel=1e-6)
    assert edge_counts(bench.faces()) == (0, 0)


def test_the_arrangement_steps_in_where_the_split_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CUTS", (("split", lambda *_: None), module.CUTS[1]))
    bench = Bench(sphere(10.0))
    outcome = bench.emboss(ON_SPHERE)
    assert isinstance(outcome, Mark)
    assert outcome.cut == "arrangement"


def test_where_no_cut_succeeds_the_mesh_is_untouched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CUTS", (("split", lambda *_: None),))
    bench = Bench(sphere(10.0))
    assert bench.emboss(ON_SPHERE) is Refusal.CUT_FAILED
    assert bench.edit().keep.all()


def _bumpy(seed: int, columns: int, rows: int, height: float) -> Surface:
    sheet = grid(10.0, 4.0, columns, rows)
    noise = np.random.default_rng(seed).uniform(-1, 1, len(sheet.positions)) * height
    inner = (np.abs(sheet.positions[:, 0]) < 4.99) & (np.abs(sheet.positions[:, 1]) < 1.99)
    return surface(sheet.positions + np.column_stack([0 * noise, 0 * noise, noise * inner]), sheet.faces)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 10**6),
    columns=st.integers(1, 60),
    rows=st.integers(1, 30),
    height=st.sampled_from([0.0, 0.005, 0.02]),
    x=st.floats(-2.5, 2.5),
    y=st.floats(-1.5, 1.5),
    turn=st.sampled_from([0.0, np.pi / 2, np.pi / 4, 1.0]),
    relief=st.sampled_from([0.05, 0.2, -0.2]),
)
def test_whatever_the_ground_a_watermark_is_whole_and_the_surface_stays_shut_or_nothing_happens(
    seed: int, columns: int, rows: int, height: float, x: float, y: float, turn: float, relief: float
) -> None:
    bench = Bench(_bumpy(seed, columns, rows, height))
    before = edge_counts(bench.surface.weld[bench.surface.faces])
    place = box_at(center=(x, y, 0.0), right=(float(np.cos(turn)), float(np.sin(turn)), 0.0), width=2.5)
    outcome = bench.emboss(place, relief=relief)
    assert edge_counts(bench.faces()) == before
    if isinstance(outcome, Mark):
        edit = bench.edit()
        caps = edit.position[edit.kind == Kind.CAP].reshape(-1, 3)
        assert np.allclose(bench.index.closest(caps)[0], abs(relief), rtol=0.02)
    else:
        assert bench.edit().keep.all()
