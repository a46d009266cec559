import json
from typing import Any

import pytest

from core.errors import ErrorCode, MeshmarkError
from core.parameters import Mode, Parameters, Preset, Solver, parse_parameters


def test_a_text_is_all_one_needs() -> None:
    asked = parse_parameters({"text": "watermark"}).resolved()
    assert (asked.count, asked.size, asked.relief, asked.solver) == (16, None, None, Solver.LEVENBERG_MARQUARDT)


def test_json_and_mappings_mean_the_same() -> None:
    data = {"text": "ab", "preset": "paper", "mode": "deboss", "color": "#AABBCC", "seed": 7}
    assert parse_parameters(json.dumps(data)) == parse_parameters(data)
    assert parse_parameters(data).color == "#aabbcc"


def test_what_is_given_wins_over_the_preset() -> None:
    asked = Parameters(text="a", preset=Preset.PAPER, relief=0.3).resolved()
    assert (asked.relief, asked.size, asked.count, asked.solver) == (0.3, 5.5, 10, Solver.ADAM)


def test_relief_grows_with_the_text_unless_it_is_given_and_is_negative_when_sunken() -> None:
    assert Parameters(text="a").relief_at(5.5) == pytest.approx(0.22)
    assert Parameters(text="a", mode=Mode.DEBOSS).relief_at(2.0) == pytest.approx(-0.08)
    assert Parameters(text="a", relief=0.1).relief_at(5.5) == 0.1


@pytest.mark.parametrize("text", ["", " ", "\t \n", "\u3000"])
def test_a_text_without_letters_has_its_own_code(text: str) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_parameters({"text": text})
    assert caught.value.code is ErrorCode.EMPTY_TEXT


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"size": -1}, "size"),
        ({"size": 31}, "size"),
        ({"size": float("nan")}, "size"),
        ({"relief": 0}, "relief"),
        ({"relief": float("inf")}, "relief"),
        ({"count": 0}, "count"),
        ({"count": 2.5}, "count"),
        ({"seed": -1}, "seed"),
        ({"color": "red"}, "color"),
        ({"color": "#12345"}, "color"),
        ({"mode": "engrave"}, "mode"),
        ({"preset": ""}, "preset"),
        ({"text": "x" * 65}, "text"),
        ({"text": 5}, "text"),
        ({"colour": "#000000"}, "colour"),
    ],
)
def test_each_wrong_value_is_named(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_parameters({"text": "a"} | wrong)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS
    assert named in caught.value.message


@pytest.mark.parametrize("broken", ["", "{", "[]", "null", '"text"', "{}", b"\xff", '{"text": NaN}'])
def test_broken_json_is_an_error_of_its_own_kind(broken: str | bytes) -> None:
    with pytest.raises(MeshmarkError) as caught:
        parse_parameters(broken)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS
