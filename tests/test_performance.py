"""The page about performance has its figures between two markers, where a command writes them, and nowhere else."""

import json
import re
from pathlib import Path

import pytest

from core.cli.order import Outcome
from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.profile import EVERY_STAGE, TO_THE_MODEL
from tests import hourly
from tests.manual import page
from tests.performance import BEGIN, END, Rate, small, written

STAGES = dict.fromkeys(EVERY_STAGE, 1.0)
FOUND = {
    "assets": [
        {"asset": "cow.glb", "status": "ok", "bytes": 10, "vertices": 8, "faces": 12, "seconds": STAGES, "total": 5.0}
        | {"processor_total": 6.0, "floor": 0.5, "ratio": 10.0, "peak": 3e8, "missing": []},
        {"asset": "wire.stl", "status": "failed", "faces": 12, "code": "no_placement", "message": "Too thin."},
        {"asset": "city.glb", "status": "ok", "bytes": 10, "vertices": 8, "faces": 20_000, "seconds": STAGES}
        | {"total": 5.0, "processor_total": 6.0, "floor": 0.5, "ratio": 10.0, "peak": 3e8, "missing": []},
    ],
    "stages": [
        {"stage": stage, "mean": 1.0, "processor": 1.5, "longest": 2.0, "share": 0.2, "law": None, "peak": 3e8}
        for stage in EVERY_STAGE
    ],
    "ratio": {"of_sums": 10.0, "median": 10.0, "least": 9.0, "most": 11.0, "law": None},
    "parameters": {"evaluate": "full"},
    "environment": {"machine": "a machine"},
    "repeats": 1,
    "notes": [],
}


def outside(text: str) -> str:
    """A page without what the command writes."""
    return text[: text.index(BEGIN)] + text[text.index(END) + len(END) :]


def test_figures_take_the_place_of_those_between_the_markers() -> None:
    before = f"# Page\n\nBefore.\n\n{BEGIN}\n\nold\n\n{END}\n\nAfter.\n"
    text = written(before, FOUND, [Rate("none", 1, 10, 20.0), Rate("geometry", 2, 10, 12.5)])
    assert outside(text) == outside(before)
    assert "old" not in text
    assert [f"| {each} |" in text for each in ("cow.glb | 10 | 8 | 12", "1 | 10 | 20.0 | 2.000 | 1,800")] == [True] * 2
    assert "| 2 | 10 | 12.5 | 1.250 | 2,880 |" in text
    assert "no_placement" in text
    assert written(text, FOUND, []).count("## ") == text.count("## ") - 1, "no small assets, no section about them"


@pytest.mark.parametrize("text", ["", BEGIN, f"{END} {BEGIN}", f"{BEGIN} {END} {BEGIN} {END}"])
def test_a_page_without_both_markers_once_is_left_alone(text: str) -> None:
    with pytest.raises(ValueError, match="once"):
        written(text, FOUND, [])


def test_small_assets_are_those_that_were_marked() -> None:
    assert small(FOUND, Path("/meshes")) == [Path("/meshes/cow.glb")]


def test_the_manuals_page_is_one_that_the_command_can_write_and_has_figures_nowhere_else() -> None:
    text = page("performance")
    assert outside(written(text, FOUND, [])) == outside(text)
    assert all(f"{stage} [s]" in text for stage in TO_THE_MODEL)
    prose = re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)", "", outside(text), flags=re.DOTALL)
    assert re.findall(r"\S*\d\S*", prose) == []


def test_few_assets_are_marked_in_turn_and_many_once() -> None:
    files = [Path("a"), Path("b"), Path("c")]
    assert [order.input.name for order in hourly.orders(files, Path())] == [*"abcabcab"]
    assert len(hourly.orders(files * 4, Path())) == 12
    assert len({order.output for order in hourly.orders(files, Path())}) == hourly.LEAST


def test_seconds_are_told_where_all_were_marked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(hourly, "mark_all", lambda wanted, *_, **__: [Outcome(order) for order in wanted])
    assert hourly.main(["cow.glb", "--jobs", "2", "--evaluate", "geometry"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["evaluate"], told["jobs"], told["marked"]) == ("geometry", 2, hourly.LEAST)
    refused = MeshmarkError(ErrorCode.NO_PLACEMENT, "Too thin.", "Choose another.")
    monkeypatch.setattr(hourly, "mark_all", lambda wanted, *_, **__: [Outcome(wanted[-1], error=refused)])
    assert hourly.main(["wire.stl"]) == 1
    assert capsys.readouterr().err == "hourly: wire.stl: no_placement: Too thin.\n"
