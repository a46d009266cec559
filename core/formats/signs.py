"""Signs by which the content of a file shows its format; its name counts only in archives."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

HEAD = 4096  # bytes at the start of a file in which most signs are


class Certainty(IntEnum):
    """The surer sign decides: all of one certainty are tested before any of the next.

    Signs of one certainty exclude each other, so that their order does not matter.
    """

    SIGNATURE = 0  # the file begins as only this format does; what begins as another known kind is refused next
    KEYWORDS = 1  # words of the format near its start
    LINES = 2  # a line of the format anywhere near its start: text of any kind may have one
    PROPORTIONS = 3  # no text at all, but its numbers fit its size


@dataclass(frozen=True)
class Sign:
    """A sign of a format.

    Attributes:
        certainty: of it.
        shows: tests a non-empty file for it.
    """

    certainty: Certainty
    shows: Callable[[bytes], bool]


def head(data: bytes) -> bytes:
    """The start of a file, without the byte order mark of UTF-8."""
    return data[:HEAD].removeprefix(b"\xef\xbb\xbf")


def begins(pattern: bytes) -> Sign:
    """The signature of files whose start matches a pattern, in which a dot is any byte."""
    compiled = re.compile(pattern, re.DOTALL)
    return Sign(Certainty.SIGNATURE, lambda data: compiled.match(head(data)) is not None)


def is_printable(data: bytes) -> bool:
    """True where there are no control characters but blanks."""
    return re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", data) is None
