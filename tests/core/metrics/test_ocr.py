from collections.abc import Sequence
from difflib import SequenceMatcher
from typing import ClassVar

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw, ImageFont

from core.choices import Evaluate
from core.gltf.scene import scene_of
from core.metrics.ocr import LOOK, SIZES, SURE, Look, Ocr, ocr
from core.metrics.recognition import Line, Reader
from core.parameters import Parameters
from core.pipeline import watermark
from core.rendering.pictures import DIRECTIONS, UPS, pictures
from core.rendering.renderer import Renderer
from tests.core.metrics.drawn import FONT, PAPER, SIZE, Picture, drawn

FRONT_BACK = [0, 6]  # among the 24 views
EMPTY = np.full((SIZE, SIZE, 3), PAPER, dtype=np.uint8)


@pytest.fixture(scope="module")
def reader() -> Reader:
    return Reader(threads=1)


def score(reader: Reader, *shown: Picture, text: str = "watermark") -> Ocr:
    return ocr(np.stack(shown), (text,), reader)


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

    def counted(picture: Picture) -> list[Line]:
        seen.append(picture)
        return detect(picture)

    monkeypatch.setattr(reader, "detect", counted)
    result = score(reader, drawn("watermark"), EMPTY, drawn("watermark"), drawn("watercolor"))
    assert len(seen) == 1 + 2 * len(SIZES)  # the last two enlarged, too
    np.testing.assert_allclose(result.per_view, [1, 0, 1, 12 / 19])


@pytest.mark.parametrize("height", [9, 12, 15])
def test_small_letters_on_a_thing_with_stronger_edges_of_its_own_are_read(
    reader: Reader, monkeypatch: pytest.MonkeyPatch, height: int
) -> None:
    sheet = Image.new("RGB", (700, 700), PAPER)
    pen = ImageDraw.Draw(sheet)
    for side in (0, 700):  # the head of an axe, with its blades and its handle
        blade = [(abs(side - x), y) for x, y in ((40, 60), (240, 120), (240, 420), (40, 520), (10, 300))]
        pen.polygon(blade, fill=(135, 150, 155))
    pen.polygon([(140, 100), (560, 100), (560, 440), (140, 440)], fill=(100, 110, 112))
    pen.rectangle((300, 80, 400, 690), fill=(70, 75, 78))
    pen.text((620, 300), "watermark", fill=(10, 10, 10), font=ImageFont.truetype(FONT, height), anchor="mm")
    assert score(reader, np.asarray(sheet)).exact == 1
    monkeypatch.setattr("core.metrics.ocr.SIZES", (1.0,))
    assert score(reader, np.asarray(sheet)).exact == 0


def look(picture: Picture, across: float, right: tuple[float, float] = (1.0, 0.0)) -> Look:
    """Of a picture with all its height in the middle, ``across`` in shares of its width."""
    top = (picture.shape[0] - LOOK) // 2
    left = min(max(round(across * picture.shape[1]) - LOOK // 2, 0), picture.shape[1] - LOOK)
    return Look(picture[top : top + LOOK, left : left + LOOK], np.array(right))


@pytest.mark.parametrize(("turn", "right"), [(0, (1.0, 0.1)), (180, (-1.0, 0.1)), (180, (1.0, 0.0))])
def test_a_look_is_read_first_the_way_in_which_its_letters_run(
    reader: Reader, monkeypatch: pytest.MonkeyPatch, turn: int, right: tuple[float, float]
) -> None:
    lines: list[int] = []
    read = reader.read

    def counted(pictures: Sequence[Picture]) -> list[str]:
        lines.append(len(pictures))
        return read(pictures)

    monkeypatch.setattr(reader, "read", counted)
    shown = drawn("watermark", turn=turn)
    assert ocr(shown[None], ("watermark",), reader, {0: look(shown, 0.5, right)}).exact == 1
    assert sum(lines) == (2 if (turn, right[0]) == (180, 1.0) else 1)


def test_pictures_are_asked_for_only_where_they_are_searched(reader: Reader) -> None:
    class Pictures:
        asked: ClassVar[list[int]] = []

        def __len__(self) -> int:
            return 3

        def __getitem__(self, view: int, /) -> Picture:
            self.asked.append(view)
            return EMPTY

    read = ocr(Pictures(), ("watermark",), reader, {1: look(drawn("watermark"), 0.5)})
    np.testing.assert_array_equal(read.per_view, [0, 1, 0])
    assert Pictures.asked == [0, 2]


@pytest.mark.parametrize("sure", [SURE, 1.0])
def test_where_a_look_finds_the_text_beyond_doubt_the_picture_is_not_searched(
    reader: Reader, monkeypatch: pytest.MonkeyPatch, sure: float
) -> None:
    searched: list[tuple[int, ...]] = []
    detect = reader.detect

    def counted(picture: Picture) -> list[Line]:
        searched.append(picture.shape[:2])
        return detect(picture)

    monkeypatch.setattr(reader, "detect", counted)
    monkeypatch.setattr("core.metrics.ocr.SURE", sure)
    shown = np.stack([drawn("watermark"), drawn("watercolor"), EMPTY])
    result = ocr(shown, ("watermark",), reader, {view: look(shown[view], 0.5) for view in (0, 1)})
    looks, enlarged = (LOOK, LOOK), (round(LOOK * SIZES[1]),) * 2
    assert searched[: 3 if sure == SURE else 4] == [looks, *([] if sure == SURE else [enlarged]), looks, enlarged]
    whole = [size for size in searched if size not in (looks, enlarged)]
    assert len(whole) == (0 if sure == SURE else 1) + 2 * len(SIZES)
    np.testing.assert_allclose(result.per_view, [1, 12 / 19, 0])


@pytest.mark.parametrize("lines", [("watermark",), ("order", "sample")])
def test_a_look_beside_the_letters_changes_nothing(reader: Reader, lines: tuple[str, ...]) -> None:
    shown = np.stack([np.pad(drawn(*lines), ((0, 0), (0, 512), (0, 0)), mode="edge")])
    for place in (0.25, 0.95):
        assert ocr(shown, ("\n".join(lines),), reader, {0: look(shown[0], place)}).exact == 1


def test_a_picture_that_is_all_in_its_look_is_searched_as_any_other(
    reader: Reader, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("core.metrics.ocr.SURE", 1.0)  # nothing is found beyond doubt
    shown = look(drawn("watermark"), 0.5).picture.copy()
    shown[-1, -1] = shown[0, -1] = shown[-1, 0] = 0  # it is not cropped
    assert ocr(shown[None], ("watermark",), reader, {0: Look(shown, np.array([1.0, 0.0]))}).exact == 1


def test_where_the_word_stands_in_the_picture_does_not_matter(reader: Reader) -> None:
    picture = drawn("watermark")
    corners = [np.roll(picture, shift, axis=(0, 1)) for shift in ((-225, -125), (225, 125))]
    assert score(reader, *corners).exact == 1


def test_the_same_pictures_give_the_same_scores(reader: Reader) -> None:
    faint = drawn("watermark", height=14, turn=30, ink=(200, 200, 200))
    np.testing.assert_array_equal(score(reader, faint).per_view, score(reader, faint).per_view)


def test_coloured_letters_on_a_plate_are_read_exactly_from_both_sides(reader: Reader) -> None:
    plate = trimesh.creation.box(extents=(30, 14, 2)).subdivide().export(file_type="glb")
    asked = Parameters(text="watermark", size=20.0, count=2, color="#d02020", evaluate=Evaluate.NONE, seed=1)
    model = watermark(plate, asked, preview=False).model
    with Renderer(1024) as renderer:
        marked, unmarked = (
            pictures(scene_of(glb), renderer, DIRECTIONS[FRONT_BACK], UPS[FRONT_BACK]) for glb in (model, plate)
        )
    assert ocr(marked, ("watermark",), reader).exact == 1
    assert ocr(unmarked, ("watermark",), reader).ratio == 0


def page(*lines: str, height: int = 36, spacing: float = 1.2, turn: float = 0.0, align: str = "center") -> Picture:
    """A text of several lines, its lines ``spacing`` ems apart."""
    sheet = Image.new("RGB", (SIZE, SIZE), PAPER)
    pen = ImageDraw.Draw(sheet)
    font = ImageFont.truetype(FONT, height)
    anchor, start = ("mm", SIZE / 2) if align == "center" else ("lm", 90)
    for row, line in enumerate(lines):
        middle = SIZE / 2 + (row - (len(lines) - 1) / 2) * spacing * height
        pen.text((start, middle), line, fill=(40, 40, 40), font=font, anchor=anchor)
    return np.asarray(sheet.rotate(turn, resample=Image.Resampling.BICUBIC, fillcolor=PAPER))


@pytest.mark.parametrize("turn", [0, 20, 90, 180, 270])
@pytest.mark.parametrize("lines", [("order", "sample"), ("Berlin", "marks", "every", "model")])
def test_a_text_of_several_lines_is_read_exactly_in_every_rotation(
    reader: Reader, lines: tuple[str, ...], turn: int
) -> None:
    assert score(reader, page(*lines, turn=turn), text="\n".join(lines)).exact == 1


@pytest.mark.parametrize("spacing", [1.0, 3.0])
@pytest.mark.parametrize("align", ["center", "left"])
def test_lines_of_unlike_length_belong_together_however_they_are_set(
    reader: Reader, spacing: float, align: str
) -> None:
    shown = page("a long first line", "short", "and another one", spacing=spacing, align=align)
    assert score(reader, shown, text="a long first line\nshort\nand another one").ratio > 0.95


def test_lines_in_the_wrong_order_are_another_text(reader: Reader) -> None:
    assert score(reader, page("first", "second"), text="first\nsecond").exact == 1
    assert score(reader, page("second", "first"), text="first\nsecond").ratio < 0.9


def test_one_of_two_lines_is_half_the_text(reader: Reader) -> None:
    half = SequenceMatcher(None, "sample order", "sample").ratio()
    assert score(reader, page("sample"), text="sample\norder").ratio == pytest.approx(half)


def test_two_lines_far_apart_are_not_one_text(reader: Reader) -> None:
    apart = score(reader, page("sample", "order", spacing=8), text="sample\norder").ratio
    assert apart == pytest.approx(SequenceMatcher(None, "sample order", "sample").ratio())


def test_a_text_that_marks_break_in_different_ways_is_read_in_each(reader: Reader) -> None:
    pictures = np.stack([page("mark sample"), page("mark", "sample")])
    assert ocr(pictures, ("mark sample", "mark\nsample"), reader).exact == 1
    assert ocr(pictures, ("mark sample",), reader).exact == 0.5


def test_two_marks_side_by_side_are_told_apart(reader: Reader) -> None:
    one = page("order", "sample", height=30)[128:384, 128:384]
    assert score(reader, np.concatenate([one, one], axis=1), text="order\nsample").exact == 1


def test_no_readings_give_no_passage(reader: Reader) -> None:
    assert score(reader, EMPTY, text="two\nlines").ratio == 0


def test_coloured_letters_in_two_lines_are_read_exactly() -> None:
    plate = trimesh.creation.box(extents=(30, 14, 2)).subdivide().export(file_type="glb")
    asked = Parameters(text="order\n4711", size=12.0, count=2, color="#d02020", seed=2)
    done = watermark(plate, asked, preview=False)
    with Renderer(1024) as renderer:
        shown = pictures(scene_of(done.model), renderer, DIRECTIONS[FRONT_BACK], UPS[FRONT_BACK])
    assert ocr(shown, ("order\n4711",), Reader(threads=1)).exact == 1
    assert done.report["metrics"]["watermark_quality"]["ocr"] > 0.15
