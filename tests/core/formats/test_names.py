import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.formats.names import code_page, decode, folded, spellings


@pytest.mark.parametrize(
    ("text", "page"),
    [
        ("Дерево", "cp1251"),
        ("Материал_01", "cp1251"),
        ("стена старая", "cp866"),
        ("grün", "cp1252"),
        ("Größe.001", "cp1252"),
        ("façade", "cp850"),
        ("grün", "cp850"),
        ("金属材质", "gb18030"),
        ("石材_01", "gb18030"),
        ("テクスチャ", "cp932"),
        ("マテリアル.001", "cp932"),
        ("재질텍스처", "cp949"),
        ("plain", "cp1252"),
        ("Дерево", "utf-8"),
    ],
)
def test_a_name_is_read_in_the_code_page_in_which_it_makes_sense(text: str, page: str) -> None:
    assert decode(text.encode(page)) == text


def test_the_names_of_one_file_are_read_in_one_code_page() -> None:
    names = [text.encode("cp1251") for text in ("Пол", "Стена", "ДВЕРЬ")]
    assert {name.decode(code_page(names)) for name in names} == {"Пол", "Стена", "ДВЕРЬ"}


def test_what_is_too_long_or_comes_too_late_to_be_a_name_is_still_a_text() -> None:
    assert decode(b"\xff" * 5000) == "\ufffd" * 5000
    late = [b"gr\xfcn"] * 300 + [b"\xff" * 5000, b"\x81"]
    assert code_page(late) == "cp1252"


@given(st.binary(max_size=40))
def test_any_bytes_are_some_text_and_what_is_shown_is_one_of_the_spellings(name: bytes) -> None:
    assert decode(name) in list(spellings(name))


@given(st.text(st.characters(codec="cp1251"), max_size=20))
def test_what_was_meant_is_among_the_spellings(text: str) -> None:
    assert text in list(spellings(text.encode("cp1251")))


def test_case_and_composition_do_not_matter_where_names_are_compared() -> None:
    assert folded("GRÜN.PNG") == folded("gru\u0308n.png")
    assert folded("Дерево") != folded("Металл")
