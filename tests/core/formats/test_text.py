import re

from hypothesis import given
from hypothesis import strategies as st

from core.formats import text
from core.formats.text import count_lines


@given(st.lists(st.sampled_from(["v", "f", " ", "\t", "\n", "\r", "x", "\ufeff"]), max_size=40), st.integers(1, 8))
def test_lines_are_counted_by_their_first_word_however_they_end_and_are_indented(parts: list[str], piece: int) -> None:
    data = "".join(parts).encode()
    bare = data.removeprefix(b"\xef\xbb\xbf")
    expected = [len(re.findall(rb"(?:\A|(?<=[\r\n]))[ \t]*" + letter + rb"[ \t]", bare)) for letter in (b"v", b"f")]
    whole, text._PIECE = text._PIECE, piece
    try:
        assert count_lines(data, b"vf") == expected
    finally:
        text._PIECE = whole
    assert count_lines(data, b"vf") == expected
