"""What comes from outside, checked: what is wrong with it is told briefly, however much is wrong."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator
from pydantic_core import PydanticCustomError

MOST = 10  # errors that are told
LONGEST_NAME, LONGEST_MESSAGE = 64, 300  # characters


class StrictModel(BaseModel):
    """A model that knows all its keys. Some unknown keys are told one by one; of many, it is told that they are many.

    An error for each takes memory, and time in which nothing else in the process moves.
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
    """The first errors of a validation, each as `name: what is wrong`, and how many more there are.

    Args:
        errors: as pydantic lists them.
        whole: what to call the input where an error is about all of it.
        skip: how many parts of each location come before the input's own names.
    """
    told = [f"{_name(error['loc'][skip:]) or whole}: {_message(error)}" for error in errors[:MOST]]
    rest = len(errors) - MOST
    return "; ".join(told) + (f"; and {rest:,} more" if rest > 0 else "")


def shortened(text: str, most: int = LONGEST_NAME) -> str:
    """A text that was sent to us, as far as it is repeated in an answer."""
    return text if len(text) <= most else f"{text[:most]}..."


def _name(location: Iterable[object]) -> str:
    # A region is reported as keep_out.0.box.box.min: the first "box" is only the kind that was recognised.
    return shortened(".".join(shortened(str(part)) for part, _ in groupby(location)))


def _message(error: Mapping[str, Any]) -> str:
    return shortened(str(error["msg"]).removeprefix("Value error, "), LONGEST_MESSAGE)
