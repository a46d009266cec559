"""Single declarations of a GLB's JSON, taken only where they are of the right type; all raise ``malformed_file``."""

import sys
from typing import Any

from core.gltf.document import malformed

Json = dict[str, Any]

_LARGEST = sys.float_info.max


def entries(json: Json, kind: str) -> list[Json]:
    """The objects of a top-level array, empty where it is missing; the gate has checked each."""
    values: list[Json] = json.get(kind, [])
    return values


def integer(owner: Json, key: str, where: str, default: int | None = None, least: int = 0) -> int:
    """An integer property of at least ``least``; ``default`` where it is missing."""
    value = owner.get(key, default)
    if type(value) is not int or value < least:
        raise malformed(f"{where}.{key} is {quote(value)}, not an integer of at least {least}.")
    return value


def reference(value: Any, json: Json, kind: str, where: str) -> int:
    """An index into a top-level array."""
    count = len(entries(json, kind))
    if type(value) is not int or not 0 <= value < count:
        raise malformed(f"{where} refers to {kind}[{quote(value)}], but there are {count:,} {kind}.")
    return value


def mapping(owner: Json, key: str, where: str) -> Json:
    """An object property, empty where it is missing."""
    value = owner.get(key, {})
    if not isinstance(value, dict):
        raise malformed(f"{where}.{key} is {quote(value)}, not an object.")
    return value


def references(owner: Json, key: str, json: Json, kind: str, where: str) -> list[int]:
    """An array of indices into a top-level array, empty where it is missing."""
    values = owner.get(key, [])
    if not isinstance(values, list):
        raise malformed(f"{where}.{key} is {quote(values)}, not an array.")
    return [reference(value, json, kind, f"{where}.{key}") for value in values]


def numbers(owner: Json, key: str, where: str, count: int | None = None) -> None:
    """Check that a property, where present, is an array of ``count`` (any number if ``None``) finite numbers."""
    values = owner.get(key)
    if key not in owner:
        return
    if not isinstance(values, list) or count not in (None, len(values)) or not all(map(_is_finite, values)):
        raise malformed(f"{where}.{key} is {quote(values)}, not an array of finite numbers of the right length.")


def _is_finite(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= _LARGEST


def quote(value: Any) -> str:
    """A value as quoted in a sentence, cut short."""
    text = "missing" if value is None else str(value)
    return text if len(text) <= 40 else text[:40] + "..."
