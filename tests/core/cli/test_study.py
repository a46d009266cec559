"""`meshmark study`: from a benchmark's results to a page, and from answers to the table."""

import json
from pathlib import Path

import pytest

from core.cli import main
from core.lab.benchmark.options import BenchmarkOptions
from core.lab.benchmark.results import write_results
from tests.core.lab.study.test_study import BOTH, BOX, row


def test_from_results_to_a_page_and_from_answers_to_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("core.lab.study.trials.SIDE", 32)
    Path("assets").mkdir()
    Path("assets/box.obj").write_bytes(BOX)
    write_results([row(method, 2) for method in BOTH], BenchmarkOptions(Path("assets"), Path()))
    assert main(["study", ".", "--out", "study.html", "--methods", ",".join(BOTH)]) == 0
    told = capsys.readouterr()
    assert told.out == "study.html: 1 trials; keep study.key.json to yourself until the answers are in\n"
    assert told.err == ".: box.obj\n"
    key = json.loads(Path("study.key.json").read_text())
    [trial] = key["trials"]
    answer = {"trial": trial, "side": "first", "question": "visibility", "yes": True}
    answers = {"schema": "meshmark.study-answers/1", "study": key["study"], "participant": "1" * 12}
    Path("a.json").write_text(json.dumps(answers | {"answers": [answer]}))
    assert main(["study", "study.key.json", "a.json"]) == 0
    assert "| untextured | `meshmark" in capsys.readouterr().out
    assert main(["study", "study.key.json"]) == 2


@pytest.mark.parametrize("more", [["--methods", "meshmark"], ["elsewhere"]])
def test_a_page_is_over_one_benchmark_and_two_methods(more: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "results", *more, "--out", "study.html"]) == 2
    assert "meshmark benchmark --out" in capsys.readouterr().err
