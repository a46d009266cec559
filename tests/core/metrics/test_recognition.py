import socket
import subprocess
import sys

import numpy as np
import pytest

from core.metrics.recognition import LINE_HEIGHT, Picture, Reader, available_threads
from tests.core.metrics.drawn import PAPER, drawn


@pytest.fixture(scope="module")
def reader() -> Reader:
    return Reader(threads=1)


def crops(reader: Reader, picture: Picture) -> list[Picture]:
    return [line.picture for line in reader.detect(picture)]


def test_a_word_is_found_once_and_read(reader: Reader) -> None:
    lines = crops(reader, drawn("watermark"))
    assert len(lines) == 1
    assert reader.read(lines) == ["watermark"]


def test_a_line_is_cut_out_close_to_its_letters_and_horizontally(reader: Reader) -> None:
    (line,) = crops(reader, drawn("watermark", height=40))
    height, width, _ = line.shape
    assert 35 < height < 80  # letters of 30 to 40 pixels and the detector's margin
    assert 230 < width < 320  # they are 254 pixels wide


@pytest.mark.parametrize("turn", [-80, -45, -20, 20, 45, 80])
def test_a_line_that_leans_by_less_than_a_quarter_turn_is_set_upright(reader: Reader, turn: int) -> None:
    assert reader.read(crops(reader, drawn("watermark", turn=turn))) == ["watermark"]


def test_an_upside_down_line_stays_so_and_reads_after_half_a_turn(reader: Reader) -> None:
    (line,) = crops(reader, drawn("watermark", turn=180))
    assert reader.read([line]) != ["watermark"]
    assert reader.read([np.rot90(line, 2)]) == ["watermark"]


def test_the_larger_line_comes_first(reader: Reader) -> None:
    small, large = drawn("small", height=24), drawn("large", height=60)
    both = np.concatenate([small[128:384], large[128:384]])
    assert reader.read(crops(reader, both)) == ["large", "small"]


def test_nothing_is_found_where_nothing_is_written(reader: Reader) -> None:
    assert crops(reader, np.full((100, 90, 3), PAPER, dtype=np.uint8)) == []
    assert crops(reader, np.full((1, 1, 3), PAPER, dtype=np.uint8)) == []


def test_no_lines_give_no_texts(reader: Reader) -> None:
    assert reader.read([]) == []


def test_texts_come_in_the_order_of_their_lines_whatever_their_widths_and_number(reader: Reader) -> None:
    words = ["a long line of words", "sign", "watermark"] * 20
    lines = {word: crops(reader, drawn(word, height=36))[0] for word in set(words)}
    assert reader.read([lines[word] for word in words]) == words


def test_the_alphabet_has_a_character_for_each_output_of_the_network(reader: Reader) -> None:
    assert len(reader._characters) == reader._recogniser.get_outputs()[0].shape[-1]


def test_a_very_long_and_low_line_is_read_too(reader: Reader) -> None:
    assert reader.read([np.full((4, 2000, 3), PAPER, dtype=np.uint8)]) == [""]


def test_a_reading_does_not_depend_on_the_lines_beside_it(reader: Reader) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (LINE_HEIGHT, 230, 3), dtype=np.uint8)
    lines = [crops(reader, drawn(word, height=18))[0] for word in ("watermark", "Hamburg", "a1b2c3")] + [noise]
    assert reader.read(lines) == [reader.read([line])[0] for line in lines]


def test_the_same_picture_gives_the_same_crops(reader: Reader) -> None:
    picture = drawn("watermark", "mesh", turn=10)
    for one, other in zip(crops(reader, picture), crops(reader, picture), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_number_of_threads_does_not_change_what_is_read(reader: Reader) -> None:
    picture = drawn("watermark", "mesh", height=16)
    more = Reader(threads=2)
    assert more.read(crops(more, picture)) == reader.read(crops(reader, picture))


def test_the_environment_sets_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert available_threads() == 3
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert available_threads() >= 1


def test_reading_needs_no_network_and_prints_nothing(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a connection was tried")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    offline = Reader(threads=1)
    assert offline.read(crops(offline, drawn("watermark"))) == ["watermark"]
    assert capfd.readouterr() == ("", "")


def test_importing_it_loads_no_downloader_and_prints_nothing() -> None:
    program = (
        "import sys, core.metrics.recognition as r; r.Reader(1); "
        "assert not {'requests', 'rapidocr.main', 'rapidocr.utils.download_file'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.parametrize("text", ["Größe 42 €", "ČESKÁ žluť", "ΑΘΗΝΑ", "水印", "ウォーターマーク", "見本 A-1"])
def test_latin_plain_greek_chinese_and_japanese_are_known(reader: Reader, text: str) -> None:
    assert reader.unknown(text) == []


@pytest.mark.parametrize("text", ["العربية", "עברית", "हिन्दी", "ไทย", "தமிழ்", "한국어", "русский"])
def test_letters_of_other_scripts_are_not(reader: Reader, text: str) -> None:
    assert reader.unknown(text) == list(dict.fromkeys(text))


def test_of_a_mixed_text_each_unknown_letter_is_named_once_and_accents_count_with_their_letters(reader: Reader) -> None:
    assert reader.unknown("Mark Ж ж e\u0301\nж ά") == ["Ж", "ж", "ά"]


def test_a_line_knows_where_it_stands_and_how_it_leans(reader: Reader) -> None:
    (line,) = reader.detect(drawn("watermark", turn=-30))
    assert line.angle == pytest.approx(30, abs=1)
    assert line.center == pytest.approx((256, 256), abs=5)


def test_how_sure_a_reading_is_goes_by_its_letters(reader: Reader) -> None:
    [line] = crops(reader, drawn("watermark"))
    noise = np.random.default_rng(0).integers(0, 255, line.shape, dtype=np.uint8)
    (text, sure), (_, unsure) = reader.read_with_confidence([line, noise])
    assert text == "watermark"
    assert sure > 0.9 > unsure
    assert reader.read_with_confidence([np.full_like(line, 128)])[0][1] == 0
