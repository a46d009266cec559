import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.artwork.line_breaks import line_breaks


def test_a_text_is_set_in_one_to_four_lines_each_as_even_as_can_be() -> None:
    assert line_breaks("made by the studio of Ada") == [
        ("made by the studio of Ada",),
        ("made by the", "studio of Ada"),
        ("made by", "the studio", "of Ada"),
        ("made", "by the", "studio", "of Ada"),
    ]


def test_ideographs_are_not_stacked_one_by_one() -> None:
    assert line_breaks("生成") == [("生成",)]


def test_lines_of_ideographs_are_read_as_lines_and_columns_as_columns() -> None:
    assert [len(lines) for lines in line_breaks("見本です")] == [1, 2]
    assert [len(lines) for lines in line_breaks("見本透かしです")] == [1, 2, 3]


def test_a_word_stays_whole() -> None:
    assert line_breaks("watermark") == [("watermark",)]


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("AI 生成", ("AI", "生成")),
        ("人工智能生成内容", ("人工智能", "生成内容")),
        ("「こんにちは」。", ("「こんに", "ちは」。")),
        ("ちょっちょっ", ("ちょっ", "ちょっ")),  # small kana begin no line
        ("「生", None),  # an opening bracket ends none, and a closing one begins none
        ("生」", None),
        ("대한민국 만세", ("대한민국", "만세")),
        ("대한민국", None),
        ("self-portrait", ("self-", "portrait")),
        ("1,000.50", None),
        ("نسخة للعرض", ("نسخة", "للعرض")),
        ("a\u00a0b", None),  # a no-break space
    ],
)
def test_lines_end_where_the_writing_allows_it(text: str, lines: tuple[str, ...] | None) -> None:
    two = [layout for layout in line_breaks(text) if len(layout) == 2]
    assert two == ([lines] if lines else [])


def test_a_text_with_line_breaks_of_its_own_keeps_them() -> None:
    assert line_breaks("made by\r\nthe studio of Ada") == [("made by", "the studio of Ada")]


@given(st.text(alphabet="ab-\u200d \u3000生。「」ょ한\u0301(\u05d0", max_size=24).filter(str.strip), st.integers(1, 6))
def test_layouts_have_all_of_the_text_and_rising_numbers_of_lines(text: str, most: int) -> None:
    layouts = line_breaks(text, most)
    assert [len(layout) for layout in layouts] == list(range(1, len(layouts) + 1))
    assert len(layouts) <= most
    for layout in layouts:
        assert all(line and line == line.strip() for line in layout)
        assert "".join("".join(layout).split()) == "".join(text.split())
