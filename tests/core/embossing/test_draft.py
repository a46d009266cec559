"""Leaning walls: what makes raised letters readable from straight ahead must not spoil a single one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection
from scipy.spatial import Delaunay

from core.artwork.outline import text_artwork
from core.embossing.draft import DRAFT, Draft, DraftOptions, draft
from core.embossing.islands import letter_islands
from tests.core.embossing.bench import LETTERS

BAR = CrossSection([np.array([[-0.4, -0.05], [0.4, -0.05], [0.4, 0.05], [-0.4, 0.05]])])
BAR_STROKE = 2 * BAR.area() / 1.8


def _outline_triangles(letters: Draft) -> tuple[np.ndarray, np.ndarray]:
    return letters.index.positions[:, :2], letters.triangles


def _areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.asarray(np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] / 2)


def test_every_side_of_a_bar_moves_inwards_by_the_same_amount() -> None:
    of_bar = draft((BAR,))
    moved = of_bar.index.positions[:, :2] + of_bar.shift
    inset = DRAFT.inset * BAR_STROKE
    assert np.allclose(np.abs(moved), [0.4 - inset, 0.05 - inset])


def test_the_inset_is_that_of_the_options() -> None:
    of_bar = draft((BAR,), DraftOptions(inset=0.4))
    moved = of_bar.index.positions[:, :2] + of_bar.shift
    assert np.allclose(np.abs(moved), [0.4 - 0.4 * BAR_STROKE, 0.05 - 0.4 * BAR_STROKE])


def test_a_stroke_is_compressed_evenly_and_its_sides_stay_straight() -> None:
    of_bar = draft((BAR,))
    points = np.array([[x, y] for x in (-0.2, 0.0, 0.2) for y in (-0.05, 0.0, 0.05)])
    moved = points + of_bar.of(points, np.array([[0, 3, 1]]))
    inset = DRAFT.inset * BAR_STROKE
    assert np.allclose(moved[:, 1], points[:, 1] * (1 - inset / 0.05), atol=1e-3)
    assert np.ptp(moved[::3, 1]) < 1e-12
    assert np.ptp(moved[2::3, 1]) < 1e-12


def test_a_hairline_beside_a_fat_stroke_stays_open() -> None:
    hairline = CrossSection([np.array([[-0.4, 0.2], [0.4, 0.2], [0.4, 0.201], [-0.4, 0.201]])])
    both = draft((BAR, hairline))
    points, triangles = _outline_triangles(both)
    assert np.all(_areas(points + both.shift, triangles) > 0)
    thin = points[:, 1] > 0.1
    assert np.linalg.norm(both.shift[thin], axis=1).max() < 0.002
    assert np.linalg.norm(both.shift[~thin], axis=1).min() > 0.005


@settings(max_examples=40)
@given(text=st.text(st.characters(codec="latin-1", categories=["L", "N", "P", "S"]), min_size=1, max_size=6))
def test_no_part_of_any_letter_turns_over_and_none_grows(text: str) -> None:
    letters = letter_islands(text_artwork(text))
    points, triangles = _outline_triangles(letters.draft)
    before, after = _areas(points, triangles), _areas(points + letters.draft.shift, triangles)
    assert np.all(after > 0.099 * before - 1e-7)
    assert 0.1 * before.sum() < after.sum() < before.sum()
    rings = [ring for island in letters.islands for ring in island.to_polygons()]
    perimeter = sum(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1).sum() for ring in rings)
    stroke = 2 * sum(island.area() for island in letters.islands) / perimeter
    assert np.linalg.norm(letters.draft.shift, axis=1).max() <= DRAFT.mitre * DRAFT.inset * stroke * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_triangles_cut_from_any_mesh_do_not_turn_over(seed: int) -> None:
    outline, triangles = _outline_triangles(LETTERS.draft)
    rng = np.random.default_rng(seed)
    corners = outline[triangles[rng.integers(0, len(triangles), 400)]]
    inner = np.einsum("nk,nkj->nj", rng.dirichlet((1.0, 1.0, 1.0), 400), corners)
    points = np.concatenate([outline, inner])
    mesh = Delaunay(points).simplices
    middle = points[mesh].mean(axis=1)
    found, _, _ = LETTERS.draft.index.closest(np.column_stack([middle, np.zeros(len(middle))]))
    mesh = mesh[found < 1e-9]
    mesh = np.where(_areas(points, mesh)[:, None] < 0, mesh[:, ::-1], mesh)
    shift = LETTERS.draft.of(points, mesh)
    assert _areas(points + shift, mesh).min() > -1e-8
    # And little of the draft is lost for it.
    wanted = np.linalg.norm(LETTERS.draft.shift, axis=1)
    assert np.linalg.norm(shift[: len(outline)], axis=1).sum() > 0.8 * wanted.sum()


def test_what_did_not_fit_stays_the_same_on_every_run() -> None:
    once, again = letter_islands(text_artwork("&§@")).draft, letter_islands(text_artwork("&§@")).draft
    assert np.array_equal(once.shift, again.shift)
