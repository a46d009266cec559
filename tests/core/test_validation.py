import json
from typing import Any

import pytest
from pydantic import ValidationError

from core.errors import MeshmarkError
from core.parameters import parse_parameters
from core.validation import LONGEST_NAME, MOST, StrictModel, describe


class Numbers(StrictModel):
    first: int = 0
    rest: dict[str, int] = {}  # noqa: RUF012


def told(data: dict[str, Any]) -> str:
    with pytest.raises(ValidationError) as caught:
        Numbers.model_validate(data)
    return describe(caught.value.errors(), "numbers")


def test_each_error_is_told_by_its_name() -> None:
    assert told({"first": "one", "rest": {"a": None}, "other": 1}) == (
        "first: Input should be a valid integer, unable to parse string as an integer; "
        "rest.a: Input should be a valid integer; other: Extra inputs are not permitted"
    )
    assert told([]).startswith("numbers: ")  # type: ignore[arg-type]


def test_of_many_errors_the_first_are_told_and_how_many_more_there_are() -> None:
    sentence = told({"rest": {str(number): "x" for number in range(1000)}})
    assert sentence.count("rest.") == MOST
    assert sentence.endswith("; and 990 more")


def test_a_long_name_is_cut() -> None:
    assert told({"n" * 10_000: 1}) == f"{'n' * LONGEST_NAME}...: Extra inputs are not permitted"


def test_many_unknown_keys_are_one_error_at_any_depth() -> None:
    many = {str(number): 1 for number in range(5000)}
    assert told(many) == "numbers: Object should have at most its 2 known keys, but has 5000"
    for text in (
        json.dumps({"text": "a", **many}),
        json.dumps({"text": "a", "keep_out": [{"node": "Head", **many}]}),
        json.dumps({"text": "a", "prefer": [{"box": {"min": [0, 0, 0], "max": [1, 1, 1], **many}}]}),
    ):
        for data in (text, json.loads(text)):
            with pytest.raises(MeshmarkError, match="known keys, but has 500") as caught:
                parse_parameters(data)
            assert len(caught.value.message) < 200
