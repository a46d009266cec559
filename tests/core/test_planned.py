"""Copies of one asset with other texts, at the places of the first."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh

from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from core.pipeline import Result, watermark
from core.plan import Plan, parse_plan
from core.report import Report
from core.series import watermark_series

BOX = trimesh.creation.box(extents=(2, 2, 2)).export(file_type="glb")


def asked(text: str) -> Parameters:
    return Parameters(text=text, count=3, evaluate=Evaluate.NONE)


def line_heights(result: Result) -> list[float]:
    """Of single lines, world units."""
    return [mark["size"][1] for mark in result.report["watermarks"]]


def places(result: Result) -> list[Any]:
    return [(mark["normal"], mark["up"]) for mark in result.report["watermarks"]]


@pytest.fixture(scope="module")
def first() -> Result:
    return watermark(BOX, asked("ORDER-4711"), preview=False)


@pytest.fixture(scope="module")
def plan(first: Result) -> Plan:
    assert first.plan is not None
    return first.plan


@pytest.fixture(scope="module")
def copy(plan: Plan) -> Result:
    return watermark(BOX, asked("ORDER-4712"), preview=False, plan=plan)


def test_a_copy_has_its_own_text_at_the_places_of_the_first(first: Result, copy: Result) -> None:
    assert {mark["text"] for mark in copy.report["watermarks"]} == {"ORDER-4712"}
    assert places(copy) == places(first)
    assert np.allclose(line_heights(copy), line_heights(first), rtol=0.02)
    assert copy.model != first.model
    assert "placing" not in copy.report["timings"]


def test_its_report_says_whose_places_it_has(first: Result, copy: Result) -> None:
    assert Report.model_validate(copy.report).plan
    assert first.report["plan"] is None
    assert copy.plan is None
    assert [mark["views"] for mark in copy.report["watermarks"]] == [
        mark["views"] for mark in first.report["watermarks"]
    ]


def test_a_plan_that_was_written_and_read_again_gives_the_same_bytes(plan: Plan, copy: Result) -> None:
    again = parse_plan(plan.to_json())
    assert again == plan
    assert watermark(BOX, asked("ORDER-4712"), preview=False, plan=again).model == copy.model


def test_a_copy_of_an_asset_that_was_read_before_is_the_same(first: Result, plan: Plan, copy: Result) -> None:
    again = [watermark(BOX, asked("ORDER-4712"), preview=False, plan=plan, before=first.asset) for _ in range(2)]
    assert [result.model for result in again] == [copy.model] * 2


TEXTS = ["AB", "ORDER-4711-EXTRA", "\N{UNICORN FACE}", "Mia"]


@pytest.fixture(scope="module")
def series() -> list[Result | MeshmarkError]:
    return list(watermark_series(BOX, [asked(text) for text in TEXTS], preview=False))


def test_places_have_room_for_the_longest_text_and_all_copies_stand_there(
    series: list[Result | MeshmarkError],
) -> None:
    refused = series[2]
    assert isinstance(refused, MeshmarkError)
    assert refused.code is ErrorCode.MISSING_GLYPHS
    short, long, other = (result for result in series if isinstance(result, Result))
    assert short.plan is not None
    assert short.plan.parameters.text == "ORDER-4711-EXTRA"
    assert [mark["text"] for mark in long.report["watermarks"]] == ["ORDER-4711-EXTRA"] * 3
    assert places(short) == places(long) == places(other)
    widths = [result.report["watermarks"][0]["size"][0] for result in (short, long, other)]
    assert widths[0] < widths[2] < widths[1], "letters are as high, and lines as wide as their text"


def test_a_copy_is_the_same_in_a_series_and_by_itself(series: list[Result | MeshmarkError]) -> None:
    alone = watermark(BOX, asked("AB"), preview=False, copies=TEXTS)
    copy = watermark(BOX, asked("Mia"), preview=False, plan=alone.plan)
    assert [result.model for result in (series[0], series[3]) if isinstance(result, Result)] == [
        alone.model,
        copy.model,
    ]


def test_a_text_without_room_is_refused(plan: Plan) -> None:
    with pytest.raises(MeshmarkError, match="the places have") as caught:
        watermark(BOX, asked("Bartholomew-Featherstonehaugh"), preview=False, plan=plan)
    assert caught.value.code is ErrorCode.TEXT_TOO_LONG
    assert "ORDER-4711" in caught.value.message


def test_a_plan_is_for_its_own_file(plan: Plan) -> None:
    other = trimesh.creation.box(extents=(2, 2, 3)).export(file_type="glb")
    with pytest.raises(MeshmarkError, match="of another file"):
        watermark(other, asked("ORDER-4712"), preview=False, plan=plan)


def _mark(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda plan: plan["marks"][0].update(values)


FORGED: dict[str, Callable[[dict[str, Any]], Any]] = {
    "another kind of file": lambda plan: plan.update(schema="meshmark.report/1"),
    "unknown fields": lambda plan: plan.update(more=1),
    "no marks": lambda plan: plan.update(marks=[]),
    "too many marks": lambda plan: plan.update(marks=plan["marks"] * 50),
    "a place far away": _mark(center=[1e9, 0, 0]),
    "a place nowhere": _mark(center=[float("nan"), 0, 0]),
    "an infinite size": _mark(size=[float("inf"), 1, 1]),
    "a negative size": _mark(size=[-1, 1, 1]),
    "skew axes": _mark(axes=[[1, 0, 0], [0.1, 1, 0], [0, 0, 1]]),
    "a mirror": _mark(axes=[[-1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "an unknown view": _mark(views=[24]),
    "views without end": _mark(views=[0] * 25),
    "a colour that is none": _mark(color="red"),
    "parameters that are none": lambda plan: plan["parameters"].update(count=65),
}


@pytest.mark.parametrize("forge", FORGED.values(), ids=FORGED.keys())
def test_what_is_no_plan_is_refused(plan: Plan, forge: Callable[[dict[str, Any]], Any]) -> None:
    content = json.loads(plan.to_json())
    parse_plan(json.dumps(content).encode())
    forge(content)
    with pytest.raises(MeshmarkError, match="plan") as caught:
        parse_plan(json.dumps(content).encode())
    assert caught.value.code is ErrorCode.INVALID_REQUEST


def test_a_plan_without_end_is_refused_unread() -> None:
    with pytest.raises(MeshmarkError, match="2,000,000 bytes"):
        parse_plan(b" " * 2_000_000)
