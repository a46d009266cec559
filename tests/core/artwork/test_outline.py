import string

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from manifold3d import CrossSection, FillRule

from core.arrays import Float
from core.artwork.artwork import Artwork
from core.artwork.outline import MAX_POINTS, text_artwork
from core.errors import ErrorCode, MeshmarkError
from tests.core.artwork.fontsmith import SQUARE, box, make_font

TEXTS = st.text(
    alphabet=string.ascii_letters + string.digits + "!?&%@#.,:;-+()[]{}'\"/\\ \u00c5\u00f6\u00f1\u00df\u00e7\u0416"
    "\u0434\u03a9\u03bb\u05d0\u05e9\u0645\u0631\u062d\u0628\u0627\u0301\u0308\u20ac\u00a9",
    min_size=1,
    max_size=12,
).filter(lambda text: bool(text.strip()))


def area(ring: Float) -> float:
    x, y = ring.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def side(p: Float, q: Float, r: Float) -> Float:
    """Which side of the line through p and q each r lies on: -1, 0 or 1."""
    return np.sign((q - p)[..., 0] * (r - p)[..., 1] - (q - p)[..., 1] * (r - p)[..., 0])


def crossings(letters: Artwork) -> int:
    """Pairs of edges, not neighbours in one ring, that meet."""
    start = np.concatenate(letters.rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in letters.rings])
    follower = np.concatenate(
        [
            np.roll(np.arange(len(ring)), -1) + offset
            for ring, offset in zip(letters.rings, offsets(letters), strict=True)
        ]
    )
    a, b, c, d = start[:, None], end[:, None], start[None], end[None]
    meet = (side(a, b, c) * side(a, b, d) <= 0) & (side(c, d, a) * side(c, d, b) <= 0)
    rows = np.arange(len(start))
    meet[rows, rows] = meet[rows, follower] = meet[follower, rows] = False
    # Collinear edges far apart pass the sign test; they meet only where their bounding boxes do.
    low, high = np.minimum(start, end), np.maximum(start, end)
    overlap = ((low[:, None] <= high[None]) & (low[None] <= high[:, None])).all(axis=2)
    return int((meet & overlap).sum())


def offsets(letters: Artwork) -> list[int]:
    return [0, *np.cumsum([len(ring) for ring in letters.rings])[:-1].tolist()]


def shapes(letters: Artwork) -> int:
    """How many disjoint shapes there are; an "i" has two."""
    return sum(area(ring) > 0 for ring in letters.rings)


def check(letters: Artwork) -> None:
    points = np.concatenate(letters.rings)
    assert np.isfinite(points).all()
    np.testing.assert_allclose(points.min(axis=0), [-0.5, -letters.aspect / 2], atol=1e-12)
    np.testing.assert_allclose(points.max(axis=0), [0.5, letters.aspect / 2], atol=1e-12)
    areas = [area(ring) for ring in letters.rings]
    assert shapes(letters) >= 1
    assert sum(areas) > 0
    assert letters.ink == pytest.approx(sum(areas) / letters.aspect)
    for ring in letters.rings:
        assert len(ring) >= 3
        assert np.linalg.norm(ring - np.roll(ring, -1, axis=0), axis=1).min() > 1e-6
    assert crossings(letters) == 0
    filled = [CrossSection(list(letters.rings), rule).area() for rule in FillRule.__members__.values()]
    even_odd, nonzero, positive, negative = filled
    np.testing.assert_allclose([even_odd, nonzero, positive], sum(areas), rtol=1e-5)
    assert negative == pytest.approx(0, abs=1e-9)


@settings(max_examples=60)
@given(TEXTS)
def test_rings_are_simple_disjoint_and_normalised_for_any_text(text: str) -> None:
    check(text_artwork(text))


@pytest.mark.parametrize(
    ("text", "count", "holes"),
    [
        ("watermark", 9, 3),
        ("AVATAR", 6, 4),
        ("i:!", 6, 0),
        ("8%&@", 6, 6),
        ("\u00c5 \u00f6 \u00f1", 6, 3),
        ("\u0645\u0631\u062d\u0628\u0627", 3, 1),
    ],
)
def test_no_shape_and_no_hole_is_lost(text: str, count: int, holes: int) -> None:
    letters = text_artwork(text)
    assert letters.label == text
    assert shapes(letters) == count
    assert sum(area(ring) < 0 for ring in letters.rings) == holes
    check(letters)


def test_the_default_word_is_round_enough_and_light_enough() -> None:
    letters = text_artwork("watermark")
    assert 200 <= sum(map(len, letters.rings)) <= 350
    assert 0.1 < letters.aspect < 0.2


def test_letters_of_a_long_text_stay_round() -> None:
    long = text_artwork("o" * 64)
    assert sum(map(len, long.rings)) / 128 >= 12


def test_letters_of_a_short_text_are_no_heavier_than_those_of_a_word() -> None:
    word = text_artwork("watermark")
    assert sum(map(len, text_artwork("a").rings)) <= 1.1 * sum(map(len, word.rings)) / 9 * 2
    assert sum(map(len, text_artwork("\u00a9").rings)) < 110


def test_the_same_text_gives_the_same_points() -> None:
    first, second = text_artwork("Meshmark 42"), text_artwork("Meshmark 42")
    for a, b in zip(first.rings, second.rings, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("cff", [False, True])
def test_overlapping_contours_are_united(cff: bool) -> None:
    plus = [box(200, 0, 100, 500), box(0, 200, 500, 100)]
    letters = text_artwork("+", make_font({"+": plus}, cff=cff))
    assert shapes(letters) == len(letters.rings) == 1
    assert len(letters.rings[0]) == 12
    assert area(letters.rings[0]) == pytest.approx(0.36)
    check(letters)


@pytest.mark.parametrize("cff", [False, True])
def test_holes_are_kept_whatever_way_the_format_winds_its_contours(cff: bool) -> None:
    ring = [SQUARE, box(100, 100, 300, 300)[::-1]]
    if cff:
        ring = [contour[::-1] for contour in ring]
    letters = text_artwork("o", make_font({"o": ring}, cff=cff))
    assert [round(area(polygon), 6) for polygon in sorted(letters.rings, key=area)] == [-0.36, 1.0]
    check(letters)


def test_overlapping_letters_are_united_even_where_one_is_wound_backwards() -> None:
    letters = text_artwork("ab", make_font({"a": [SQUARE], "b": [SQUARE[::-1]]}, advance=250))
    assert shapes(letters) == 1
    assert area(letters.rings[0]) == pytest.approx(1 * 500 / 750)
    check(letters)


@pytest.mark.parametrize(
    "contours",
    [
        [box(0, 0, 200, 200), box(200, 200, 200, 200)],  # touching at a corner
        [SQUARE, box(100, 0, 50, 200)[::-1], box(150, 200, 100, 100)[::-1]],  # holes touching each other and the rim
    ],
)
def test_shapes_that_touch_in_a_point_are_parted(contours: list[list[tuple[int, int]]]) -> None:
    check(text_artwork("x", make_font({"x": contours})))


def test_neighbouring_letters_without_a_gap_become_one_shape() -> None:
    letters = text_artwork("aaa", make_font({"a": [SQUARE]}, advance=500))
    assert shapes(letters) == 1
    assert len(letters.rings[0]) == 4


def test_specks_are_dropped() -> None:
    letters = text_artwork("a" * 9, make_font({"a": [box(0, 0, 900, 900), box(950, 950, 1, 1)]}, advance=1000))
    assert shapes(letters) == 9
    check(letters)


def test_an_outline_of_too_many_points_is_refused() -> None:
    comb = [(x, 400 + 90 * (x % 2)) for x in range(800)]
    font = make_font({"a": [[(0, 0), *comb, (799, 0)]]}, advance=800)
    assert sum(map(len, text_artwork("a", font).rings)) > 700
    with pytest.raises(MeshmarkError, match="points") as caught:
        text_artwork("a" * (MAX_POINTS // 800 + 1), font)
    assert caught.value.code == ErrorCode.INVALID_PARAMETERS


def test_a_font_sent_with_the_request_is_used() -> None:
    assert text_artwork("a", make_font({"a": [SQUARE]})).aspect == pytest.approx(1.0)


def test_a_variable_font_is_used_at_its_default_instance() -> None:
    plain, variable = (
        text_artwork("ab", make_font({"a": [SQUARE], "b": [SQUARE]}, widened=axis)) for axis in ("", "wdth")
    )
    for a, b in zip(plain.rings, variable.rings, strict=True):
        np.testing.assert_array_equal(a, b)


def test_joiners_alone_are_no_text() -> None:
    with pytest.raises(MeshmarkError) as caught:
        text_artwork("\u200d\u200c")
    assert caught.value.code == ErrorCode.EMPTY_TEXT
