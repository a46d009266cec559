"""The Unicode bidirectional algorithm (UAX 9) over one line."""

import unicodedata
from collections.abc import Iterator
from typing import Any

from bidi import algorithm
from bidi.mirror import MIRRORED

_STRONG = {"L": "L", "R": "R", "EN": "R", "AN": "R"}  # what rule N0 takes each type for


def visual_order(text: str) -> list[tuple[int, int]]:
    """The characters of ``text`` from left to right as displayed (rules P2 to L2): index and embedding level of each.

    The base direction is that of the first strong character.
    """
    level = algorithm.get_base_level(text)
    storage = algorithm.get_empty_storage() | {"base_level": level, "base_dir": "LR"[level]}
    algorithm.get_embedding_levels(text, storage)
    for index, character in enumerate(storage["chars"]):
        character["index"] = index
    algorithm.explicit_embed_and_overrides(storage)
    algorithm.resolve_weak_types(storage)
    _resolve_brackets(storage["chars"], storage["base_dir"])
    algorithm.resolve_neutral_types(storage, False)
    algorithm.resolve_implicit_levels(storage, False)
    algorithm.reorder_resolved_levels(storage, False)
    return [(item["index"], item["level"]) for item in storage["chars"]]


def _resolve_brackets(characters: list[dict[str, Any]], base: str) -> None:
    """Give paired brackets a direction (rule N0); python-bidi leaves it out.

    Formatting characters are refused in a text, so the line is one isolating run sequence.
    """
    for opening, closing in sorted(_bracket_pairs(characters)):
        inside = {_STRONG.get(item["type"]) for item in characters[opening + 1 : closing]} - {None}
        if not inside:
            continue
        before = (_STRONG.get(item["type"]) for item in reversed(characters[:opening]))
        context = next((direction for direction in before if direction), base)
        direction = base if base in inside else context
        characters[opening]["type"] = characters[closing]["type"] = direction


def _bracket_pairs(characters: list[dict[str, Any]]) -> Iterator[tuple[int, int]]:
    """The places of paired brackets (definition BD16)."""
    opened: list[tuple[str, int]] = []
    for index, item in enumerate(characters):
        character = item["ch"]
        kind = unicodedata.category(character) if character in MIRRORED else ""
        if kind == "Ps":
            opened.append((MIRRORED[character], index))
        elif kind == "Pe" and any(character == wanted for wanted, _ in opened):
            while opened:
                wanted, start = opened.pop()
                if wanted == character:
                    yield start, index
                    break
