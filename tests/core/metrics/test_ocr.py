from difflib import SequenceMatcher

import numpy as np
import pytest
import trimesh

from core.gltf.scene import scene_of
from core.metrics.ocr import Ocr, ocr
from core.metrics.recognition import Reader
from core.parameters import Evaluate, Parameters
from core.pipeline import watermark
from core.rendering.pictures import DIRECTIONS, UPS, pictures
from core.rendering.renderer import Renderer
from tests.core.metrics.drawn import PAPER, SIZE, Picture, drawn

FRONT_BACK = [0, 6]  # among the 24 views
EMPTY = np.full((SIZE, SIZE, 3), PAPER, dtype=np.uint8)


@pytest.fixture(scope="module")
def reader() -> Reader:
    return Reader(threads=1)


def score(reader: Reader, *shown: Picture, text: str = "watermark") -> Ocr:
    return ocr(np.stack(shown), text, reader)


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_a_clear_word_is_read_exactly_in_every_rotation(reader: Reader, turn: int) -> None:
    result = score(reader, drawn("watermark", turn=turn))
    assert (result.ratio, result.ge_08, result.exact) == (1, 1, 1)


@pytest.mark.parametrize("text", ["I", "A"])
def test_a_single_letter_that_is_taller_than_wide_is_read(reader: Reader, text: str) -> None:
    assert score(reader, drawn(text, height=120), text=text).exact == 1


def test_an_empty_picture_scores_nothing(reader: Reader) -> None:
    result = score(reader, EMPTY)
    assert (result.ratio, result.ge_08, result.exact) == (0, 0, 0)


def test_another_word_scores_what_difflib_says(reader: Reader) -> None:
    expected = SequenceMatcher(None, "watermark", "watercolor").ratio()
    result = score(reader, drawn("watercolor"))
    assert result.ratio == expected == pytest.approx(2 * 6 / 19)
    assert (result.ge_08, result.exact) == (0, 0)


def test_a_word_with_a_wrong_letter_counts_as_readable_but_not_as_exact(reader: Reader) -> None:
    result = score(reader, drawn("watermork"))
    assert result.ratio == pytest.approx(16 / 18)
    assert (result.ge_08, result.exact) == (1, 0)


def test_capitals_and_small_letters_count_the_same(reader: Reader) -> None:
    assert score(reader, drawn("WATERMARK")).exact == 1
    assert score(reader, drawn("watermark"), text="WaterMark").exact == 1


def test_of_several_words_the_best_counts(reader: Reader) -> None:
    assert score(reader, drawn("merchant", "watermark", "elephant")).ratio == 1
    best = max(SequenceMatcher(None, "watermark", word).ratio() for word in ("merchant", "market"))
    assert score(reader, drawn("merchant", "market")).ratio == pytest.approx(best)


def test_the_score_is_the_mean_over_views_and_the_shares_count_them(reader: Reader) -> None:
    result = score(reader, drawn("watermark"), EMPTY, drawn("watermork"), drawn("watercolor"))
    np.testing.assert_allclose(result.per_view, [1, 0, 16 / 18, 12 / 19])
    assert result.ratio == pytest.approx((1 + 16 / 18 + 12 / 19) / 4)
    assert (result.ge_08, result.exact) == (0.5, 0.25)


def test_a_view_that_occurs_twice_counts_twice_but_is_read_once(
    reader: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Picture] = []
    detect = reader.detect

    def counted(picture: Picture) -> list[Picture]:
        seen.append(picture)
        return detect(picture)

    monkeypatch.setattr(reader, "detect", counted)
    result = score(reader, drawn("watermark"), EMPTY, drawn("watermark"), drawn("watercolor"))
    assert len(seen) == 3
    np.testing.assert_allclose(result.per_view, [1, 0, 1, 12 / 19])


def test_where_the_word_stands_in_the_picture_does_not_matter(reader: Reader) -> None:
    picture = drawn("watermark")
    corners = [np.roll(picture, shift, axis=(0, 1)) for shift in ((-225, -125), (225, 125))]
    assert score(reader, *corners).exact == 1


def test_the_same_pictures_give_the_same_scores(reader: Reader) -> None:
    faint = drawn("watermark", height=14, turn=30, ink=(200, 200, 200))
    np.testing.assert_array_equal(score(reader, faint).per_view, score(reader, faint).per_view)


def test_coloured_letters_on_a_plate_are_read_exactly_from_both_sides(reader: Reader) -> None:
    plate = trimesh.creation.box(extents=(30, 14, 2)).subdivide().export(file_type="glb")
    asked = Parameters(text="watermark", size=20.0, count=2, color="#d02020", evaluate=Evaluate.NONE)
    model = watermark(plate, asked, preview=False).model
    with Renderer(1024) as renderer:
        marked, unmarked = (
            pictures(scene_of(glb), renderer, DIRECTIONS[FRONT_BACK], UPS[FRONT_BACK]) for glb in (model, plate)
        )
    assert ocr(marked, "watermark", reader).exact == 1
    assert ocr(unmarked, "watermark", reader).ratio == 0
