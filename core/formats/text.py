"""Numbers out of the lines of a text file, without a Python object per line."""

import re
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.refusals import malformed

Scalar = TypeVar("Scalar", np.float64, np.int64)

_TAB, _NEWLINE, _RETURN, _BLANK = 9, 10, 13, 32
_MARK = b"\xef\xbb\xbf"  # of byte order
_PIECE = 2**20  # bytes
_CONTROLS_AS_BLANKS = bytes(_BLANK if code < _BLANK and code != _NEWLINE else code for code in range(256))
_MICROSOFT = re.compile(rb"(?<!\S)[-+]?1\.#(?:IND|INF|QNAN|SNAN)\d*(?!\S)")  # not a number, to its C library
_NO_NUMBER = re.compile(rb"(?<!\S)(?![-+]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][-+]?\d++)?(?!\S))\S+")


def joined_lines(data: bytes) -> bytes:
    """The text with each line that ends in a backslash joined with the next one.

    A backslash behind a byte of no ASCII is the second half of a letter in Shift JIS or GBK.
    """
    if b"\\\n" not in data and b"\\\r" not in data:
        return data
    return re.sub(rb"(?<![\x80-\xff])\\(\r\n|\n|\r)", b" ", data)


class Lines:
    """The lines of a text as offsets into its bytes.

    Args:
        data: the text; a byte order mark, line endings of any kind and indentation are taken off.
    """

    def __init__(self, data: bytes) -> None:
        text = data.removeprefix(_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n") + b"\n"
        self.text = re.sub(rb"\n[ \t]+", b"\n", text).lstrip(b" \t")
        self.buffer = np.frombuffer(self.text, np.uint8)
        self.end = np.flatnonzero(self.buffer == _NEWLINE)
        self.start = np.concatenate([[0], self.end[:-1] + 1])

    def __len__(self) -> int:
        return len(self.end)

    def __getitem__(self, index: int) -> bytes:
        return self.text[self.start[index] : self.end[index]]

    def keyword(self, word: bytes) -> NDArray[np.bool_]:
        """(N,) lines that start with ``word`` as a word of its own."""
        mask = np.asarray(self.end - self.start >= len(word))
        start = self.start[mask]
        found = np.isin(self.buffer[start + len(word)], tuple(b" \t\n"))
        for offset, letter in enumerate(word):
            found &= self.buffer[start + offset] == letter
        mask[mask] = found
        return mask

    def select(self, mask: NDArray[np.bool_], skip: int) -> bytes:
        """The text of some lines without their first ``skip`` bytes and without trailing comments.

        A comment starts at the start of a word: ``-1.#IND00`` holds none.
        """
        length = self.end - self.start + 1
        block = self.buffer[np.repeat(mask, length)]
        start = np.cumsum(length[mask]) - length[mask]
        for offset in range(skip):
            block[start + offset] = _BLANK
        text = block.tobytes()
        return re.sub(rb"(?<!\S)#[^\n]*", b"", text) if b"#" in text else text


def count_lines(data: bytes, letters: bytes) -> list[int]:
    """Numbers of lines that start with each of these letters as a word of its own, indented or not.

    The time hardly depends on the content of the text, and the memory is that of a piece of it.
    """
    buffer = np.frombuffer(data, np.uint8, offset=len(_MARK) if data.startswith(_MARK) else 0)
    counts = np.zeros(256, np.int64)
    after_end = True  # only blanks are between the end of a line and the piece
    for at in range(0, len(buffer), _PIECE):
        piece = buffer[at : at + _PIECE + 1]  # one more, by which the last letter is a word or not
        blank = (piece == _BLANK) | (piece == _TAB)
        body, is_blank = piece[:-1], blank[:-1]
        words = np.flatnonzero(np.logical_or.reduce([body == letter for letter in letters]) & blank[1:])
        before = np.where(words > 0, body[words - 1], _BLANK)
        is_first = _ends_line(before)
        if indented := np.flatnonzero((before == _BLANK) | (before == _TAB)).tolist():
            place = np.maximum.accumulate(np.where(is_blank, -1, np.arange(len(body), dtype=np.int32)))
            last = np.where(words[indented] > 0, place[words[indented] - 1], -1)
            is_first[indented] = np.where(last < 0, after_end, _ends_line(body[last]))
        counts += np.bincount(body[words[is_first]], minlength=256)
        if not is_blank.all():
            after_end = bool(_ends_line(body[[len(body) - 1 - np.argmin(is_blank[::-1])]])[0])
    return [int(counts[letter]) for letter in letters]


def _ends_line(characters: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.asarray((characters == _NEWLINE) | (characters == _RETURN))


def tokens_per_line(text: bytes) -> NDArray[np.int64]:
    """(N,) number of blank-separated tokens in each line; every line ends with a newline."""
    if not text:
        return np.empty(0, np.int64)
    buffer = np.frombuffer(text, np.uint8)
    end = np.flatnonzero(buffer == _NEWLINE)
    return np.asarray(np.add.reduceat(token_starts(buffer), np.concatenate([[0], end[:-1] + 1]), dtype=np.int64))


def token_starts(buffer: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(N,) bytes of an array at which a token starts."""
    starts = buffer > _BLANK
    starts[1:] &= buffer[:-1] <= _BLANK
    return starts


def parse_numbers(text: bytes, dtype: type[Scalar], what: str) -> NDArray[Scalar]:
    """(N,) the blank-separated numbers of a text.

    Args:
        text: the numbers.
        dtype: ``np.float64`` or ``np.int64``.
        what: kind of the numbers, for the error: "vertex", "face".

    Raises:
        MeshmarkError: ``malformed_file``, quoting the first token that is not a number.
    """
    try:
        return _numbers(text, dtype)
    except ValueError:
        if dtype is np.float64 and _MICROSOFT.search(text):
            return parse_numbers(_MICROSOFT.sub(b"nan", text), dtype, what)
        raise malformed(f"A {what} line holds {_first_bad_token(text, dtype)!r} where a number belongs.") from None


def readable_numbers(text: bytes) -> NDArray[np.float64]:
    """(N,) the blank-separated numbers of a text; NaN for a token that is none."""
    try:
        return _numbers(text, np.float64)
    except ValueError:
        return _numbers(_NO_NUMBER.sub(b"nan", text.translate(_CONTROLS_AS_BLANKS)), np.float64)


def _numbers(text: bytes, dtype: type[Scalar]) -> NDArray[Scalar]:
    if not text.strip():
        return np.empty(0, dtype)  # numpy would read one number here
    return np.fromstring(text, dtype, sep=" ")


def _first_bad_token(text: bytes, dtype: Any) -> str:
    for match in re.finditer(rb"\S+", text):
        try:
            int(match[0]) if dtype is np.int64 else float(match[0])
        except ValueError:
            return match[0][:40].decode("ascii", "replace")
    return "a malformed number"
