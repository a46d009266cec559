"""Validation of input from outside: errors are reported briefly, also where there are many."""

import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator
from pydantic_core import PydanticCustomError

MOST = 10  # errors that are reported
LONGEST_NAME, LONGEST_MESSAGE = 64, 300  # characters


class StrictModel(BaseModel):
    """A model without unknown keys. Some are reported one by one; many as one error.

    An error for each would take memory, and time that blocks the process.
    """

    model_config = ConfigDict(extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _has_few_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, dict) and len(data) > len(cls.model_fields) + MOST:
            raise PydanticCustomError(
                "too_many_keys",
                "Object should have at most its {known} known keys, but has {actual}",
                {"known": len(cls.model_fields), "actual": len(data)},
            )
        return data


def describe(errors: Sequence[Mapping[str, Any]], whole: str, skip: int = 0) -> str:
    """The first errors of a validation, each as `name: what is wrong`, and the number of further ones.

    Args:
        errors: as pydantic lists them.
        whole: name of the input where an error is about all of it.
        skip: number of parts of each location before the input's own names.
    """
    told = [f"{_name(error['loc'][skip:]) or whole}: {_message(error)}" for error in errors[:MOST]]
    rest = len(errors) - MOST
    return "; ".join(told) + (f"; and {rest:,} more" if rest > 0 else "")


def first_repeat(texts: Sequence[str]) -> tuple[int, int] | None:
    """The numbers of the first two of the ``texts`` that would be embossed alike; None where all differ."""
    numbers: dict[str, int] = {}
    for number, text in enumerate(texts):
        if (before := numbers.setdefault(unicodedata.normalize("NFC", text.strip()), number)) != number:
            return before, number
    return None


def shortened(text: str, most: int = LONGEST_NAME) -> str:
    """The part of a received text that is repeated in an answer."""
    return text if len(text) <= most else f"{text[:most]}..."


def _name(location: Iterable[object]) -> str:
    # A region is reported as keep_out.0.box.box.min: the first "box" is only the kind that was recognised.
    return shortened(".".join(shortened(str(part)) for part, _ in groupby(location)))


def _message(error: Mapping[str, Any]) -> str:
    return shortened(str(error["msg"]).removeprefix("Value error, "), LONGEST_MESSAGE)
