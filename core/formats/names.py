"""Texts of names of files and materials that are bytes in an undeclared code page."""

import math
import unicodedata
from collections.abc import Iterable, Iterator
from itertools import islice

# Code pages that exporters and packers of the last thirty years wrote, the likelier ones first.
_SCORED = ("cp1252", "cp1251", "cp866", "cp850", "cp437", "gb18030", "cp932", "cp949", "cp950")
_UNSCORED = ("cp1250", "cp1253", "cp1254", "cp852", "mac_roman")
_LONGEST = 1024  # bytes of a name that are read: no file system has longer ones
_NAMES, _SAMPLE = 256, 256  # names that must be valid in a code page, and characters of them that it is detected by

# Logarithms of the frequencies of kinds of characters: text read in a wrong code page is full of the rare kinds. The
# large alphabets count as one over their common characters, times the relative frequency of such names among assets.
_IN_PLACE = math.log(1 / 60)  # a letter of a small alphabet where it belongs: "grün", "Дерево"
_CAPITAL = math.log(1 / 150)
_OUT_OF_PLACE = math.log(1 / 5000)  # Latin letters in a row: "Äåðåâî"; lower case before upper case
_KANA, _IDEOGRAPH, _SYLLABLE = math.log(1 / 120), math.log(1 / 4000), math.log(1 / 2500)
_BIG5 = math.log(1 / 8000)
_ASCII = math.log(1 / 20)  # also the frequency of such a letter right beside one of East Asia
_KOREAN = math.log(1 / 5)  # names in Korean, of which many could be Chinese ones
_MARK = math.log(1e-4)
_RARE = math.log(1e-6)


def decode(name: bytes) -> str:
    """The text of a name: UTF-8, else in the likeliest code page."""
    return texts([name])[name]


def texts(names: Iterable[bytes]) -> dict[bytes, str]:
    """The texts of names by one program, in one code page; U+FFFD for bytes that are no text in it."""
    distinct = dict.fromkeys(names)
    page = code_page(distinct)
    return {name: name.decode(page, "replace") for name in distinct}


def code_page(names: Iterable[bytes]) -> str:
    """The one encoding of several names by the same program, as Python calls it.

    It is detected by the first of them, so that a later one may be invalid in it.
    """
    telling = (name for name in names if not name.isascii() and len(name) <= _LONGEST)
    joined = b"\n".join(islice(telling, _NAMES))
    if decoded(joined, "utf-8") is not None:
        return "utf-8"
    possible = [page for page in _SCORED if decoded(joined, page) is not None]
    return max(possible, key=lambda page: _likelihood(joined.decode(page)[:_SAMPLE], page))


def spellings(name: bytes) -> Iterator[str]:
    """All texts that a name can mean, UTF-8 first."""
    if name.isascii():
        yield name.decode("ascii")
        return
    texts = (decoded(name[:_LONGEST], page) for page in ("utf-8", *_SCORED, *_UNSCORED))
    yield from dict.fromkeys(text for text in texts if text is not None)


def folded(text: str) -> str:
    """The form in which names are compared: case and the two ways to write an accent do not matter."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", text).casefold())


def decoded(name: bytes, page: str) -> str | None:
    """The text of a name in an encoding; ``None`` where it is none."""
    try:
        return name.decode(page)
    except UnicodeDecodeError:
        return None


def _likelihood(text: str, page: str) -> float:
    """Log-likelihood of names in a code page."""
    each = (
        _ASCII if character.isascii() else _rarity(character, before, after, page)
        for before, character, after in zip(f"\n{text}", text, f"{text}\n"[1:], strict=False)
    )
    return sum(each) + (_KOREAN if page == "cp949" else 0)


def _rarity(character: str, before: str, after: str, page: str) -> float:
    kind = unicodedata.name(character, "").partition(" ")[0]
    match kind:
        case "LATIN" | "CYRILLIC" if _belongs(character, before, after, kind):
            return _CAPITAL if character.isupper() else _IN_PLACE
        case "LATIN" | "CYRILLIC":
            return _OUT_OF_PLACE
        case "HIRAGANA" | "KATAKANA" | "HANGUL" | "CJK":
            mixed = any(other.isascii() and other.isalpha() for other in (before, after))
            return _east_asian(character, kind, page) + (_ASCII if mixed else 0)
        case "HALFWIDTH" | "":
            return _RARE
    return _MARK


def _belongs(character: str, before: str, after: str, kind: str) -> bool:
    """True where a letter of a small alphabet is in its usual context: between those of the same case and alphabet."""
    if (before.islower() and character.isupper()) or (before.isupper() and after.isupper() and character.islower()):
        return False
    if kind == "LATIN":  # the accented ones of western Europe, hardly ever three in a row
        return character <= "\u00ff" and any(other.isascii() for other in (before, after))
    is_common = "\u0410" <= character <= "\u044f" or character in "ёЁіїєґІЇЄҐ"
    return is_common and not any(other.isascii() and other.isalpha() for other in (before, after))


def _east_asian(character: str, kind: str, page: str) -> float:
    """Ideographs of daily use come first in the national standards: by their leading byte."""
    lead, trail = (code := character.encode(page))[0], code[-1]
    match kind, page:
        case "HIRAGANA" | "KATAKANA", _:
            return _KANA
        case "HANGUL", "cp949":
            return _SYLLABLE
        case _, "gb18030" if 0xB0 <= lead <= 0xD7 and trail >= 0xA1 and len(code) == 2:
            return _IDEOGRAPH
        case _, "cp932" if 0x88 <= lead <= 0x97:
            return _IDEOGRAPH
        case _, "cp950" if 0xA4 <= lead <= 0xC6:
            return _BIG5
    return _RARE
