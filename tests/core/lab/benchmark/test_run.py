"""A benchmark keeps every finished row, whatever ends it, and makes each of the others once."""

import csv
import json
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.options import AttackRequest, BenchmarkOptions
from core.lab.benchmark.pool import THREADS
from core.lab.benchmark.rows import Row, read
from core.lab.benchmark.run import run
from tests.core.lab.benchmark.fakes import expected, open_fake, options
from tests.worker.waiting import PATIENCE, wait_until

ROOT = Path(__file__).parents[4]


def by_asset(rows: list[Row], name: str) -> list[Row]:
    return [row for row in rows if row["asset"] == f"{name}.obj"]


def lines(asked: BenchmarkOptions) -> list[str]:
    return [json.loads(line)["key"] for line in (asked.out / "rows.jsonl").read_text().splitlines()]


def test_a_run_makes_every_combination_once_and_a_second_run_makes_none(tmp_path: Path) -> None:
    asked = options(tmp_path, "a", "b", processes=2)
    rows = run(asked, open_fake)
    # Two methods at 4 and 16, and a crop at 4.
    assert Counter((row["method"], row["count"], row["attack"]) for row in by_asset(rows, "a")) == Counter(
        {(method, *rest): 1 for method in asked.methods for rest in ((4, "none"), (4, "crop"), (16, "none"))}
    )
    assert all(row["status"] == "ok" for row in rows)
    assert Counter(lines(asked)) == Counter({row["key"]: 1 for row in rows})
    before = (asked.out / "rows.jsonl").read_bytes()
    assert {row["key"] for row in run(asked, open_fake)} == {row["key"] for row in rows}
    assert (asked.out / "rows.jsonl").read_bytes() == before


def test_the_results_are_there_as_csv_json_and_markdown(tmp_path: Path) -> None:
    asked = options(tmp_path, "a")
    rows = run(asked, open_fake)
    with (asked.out / "results.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [(line["method"], line["wps"], line["seconds_run"]) for line in table] == [
        (row["method"], "0.5", "1.0") for row in rows
    ]
    whole = json.loads((asked.out / "results.json").read_text())
    assert whole["schema"] == "meshmark.benchmark/1"
    assert whole["rows"] == rows
    assert whole["options"]["counts"] == [4, 16]
    assert whole["environment"]["python"]
    assert "| meshmark | 16 | 1 of 1 (100%) |" in (asked.out / "REPORT.md").read_text()


def test_other_counts_add_rows_and_other_settings_make_all_anew(tmp_path: Path) -> None:
    first = run(options(tmp_path, "a", counts=(4,)), open_fake)
    more = run(options(tmp_path, counts=(4, 16)), open_fake)
    assert {row["key"] for row in first} < {row["key"] for row in more}
    other = run(options(tmp_path, counts=(4,), relief=0.05), open_fake)
    assert not {row["key"] for row in first} & {row["key"] for row in other}


def test_the_seed_of_an_asset_depends_on_its_content_and_the_given_seed(tmp_path: Path) -> None:
    seeds = [{row["seed"] for row in run(options(tmp_path, "a", "b", seed=seed), open_fake)} for seed in (0, 0, 1)]
    assert seeds[0] == seeds[1]
    assert len(seeds[0]) == 2
    assert not seeds[0] & seeds[2]


def test_a_refusal_is_a_row_with_its_code_and_nothing_else_is_lost(tmp_path: Path) -> None:
    rows = run(options(tmp_path, "refused", "unreadable", "buggy", "good"), open_fake)
    refused = by_asset(rows, "refused")
    assert {(row["method"], row["status"], row.get("code")) for row in refused} == {
        ("meshmark", "ok", None),
        ("li", "failed", "not_manifold"),
    }
    assert {row["message"] for row in refused if row["status"] == "failed"} == {"It has a hole."}
    assert {row["code"] for row in by_asset(rows, "unreadable")} == {"malformed_file"}
    assert {row["code"] for row in by_asset(rows, "buggy") if row["method"] == "li"} == {"internal_error"}
    assert [row["status"] for row in by_asset(rows, "good")] == ["ok"] * 6


def test_a_crash_fails_only_the_rows_that_needed_the_step_that_crashed(tmp_path: Path) -> None:
    asked = options(tmp_path, "crashing", "fatal", "good", processes=2)
    rows = run(asked, open_fake)
    crashed = {(row["method"], row["count"], row["attack"]) for row in by_asset(rows, "crashing") if "code" in row}
    assert crashed == {("li", 4, "none"), ("li", 4, "crop")}
    assert {row["code"] for row in rows if "code" in row} == {"engine_crashed"}
    assert "SIGSEGV" in next(row["message"] for row in by_asset(rows, "crashing") if "code" in row)
    assert all("exit status 3" in row["message"] for row in by_asset(rows, "fatal"))
    assert {row["key"] for row in rows} == expected(rows, asked)


def test_a_step_that_hangs_is_given_up(tmp_path: Path) -> None:
    rows = run(options(tmp_path, "hanging", row_seconds=6.0), open_fake)
    assert [(row["method"], row["count"], row["attack"], row["code"]) for row in rows if "code" in row] == [
        ("li", 4, "crop", "time_limit")
    ]
    assert len(rows) == 6


def test_failures_are_made_again_only_on_request(tmp_path: Path) -> None:
    asked = options(tmp_path, "refused")
    run(asked, open_fake)
    count = len(lines(asked))
    run(asked, open_fake)
    assert len(lines(asked)) == count
    again = run(options(tmp_path, retry_failed=True), open_fake)
    assert len(lines(asked)) == count + 3
    assert len(again) == count


def test_a_half_written_last_line_is_dropped_and_its_row_made_again(tmp_path: Path) -> None:
    asked = options(tmp_path, "a")
    rows = run(asked, open_fake)
    path = asked.out / "rows.jsonl"
    path.write_bytes(path.read_bytes()[:-20])
    assert len(read(asked.out)) == len(rows) - 1
    assert {row["key"] for row in run(asked, open_fake)} == {row["key"] for row in rows}
    assert Counter(lines(asked)) == Counter({row["key"]: 1 for row in rows})


def test_a_damaged_line_in_the_middle_is_named(tmp_path: Path) -> None:
    (tmp_path / "rows.jsonl").write_text('{"key": "a"}\nrubbish\n{"key": "b"}\n')
    with pytest.raises(MeshmarkError, match="Line 2"):
        read(tmp_path)


SCRIPT = """
import signal
from pathlib import Path
from core.lab.benchmark.run import run
from tests.core.lab.benchmark.fakes import open_fake, options
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # as in a terminal, also where the tests run without one
    run(options(Path({folder!r}), processes=2), open_fake)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_run_that_is_ended_in_the_middle_goes_on_where_it_stopped(tmp_path: Path, number: int) -> None:
    asked = options(tmp_path, *(f"slow-{row}" for row in range(6)))
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(folder=str(tmp_path)))
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [sys.executable, str(script)], cwd=ROOT, env=environment, start_new_session=True, stderr=subprocess.DEVNULL
    )
    rows = asked.out / "rows.jsonl"
    wait_until(lambda: rows.exists() and rows.read_bytes().count(b"\n") >= 5)
    assert process.poll() is None, "it has not ended by itself"
    if number == signal.SIGINT:
        os.killpg(process.pid, number)  # a terminal sends Ctrl-C to every process of the group
    else:
        process.kill()
    process.wait(timeout=PATIENCE)
    kept = set(lines_whole(rows))
    assert 5 <= len(kept) < 36

    finished = run(asked, open_fake)
    assert len(finished) == 36
    assert Counter(lines(asked)) == Counter({row["key"]: 1 for row in finished})
    assert kept <= {row["key"] for row in finished}
    assert {row["key"] for row in finished} == expected(finished, asked)


def lines_whole(path: Path) -> list[str]:
    return [json.loads(line)["key"] for line in path.read_bytes().split(b"\n")[:-1]]


def test_two_runs_cannot_write_to_one_folder(tmp_path: Path) -> None:
    from core.lab.benchmark.rows import appending

    asked = options(tmp_path, "a")
    with appending(asked.out), pytest.raises(MeshmarkError, match="Another benchmark"):
        run(asked, open_fake)


def test_the_report_is_made_again_from_the_rows_alone(tmp_path: Path) -> None:
    asked = options(tmp_path, "a", "b")
    run(asked, open_fake)
    before = (asked.out / "REPORT.md").read_bytes()
    for name in ("REPORT.md", "results.csv", "run-time.png"):
        (asked.out / name).unlink()
    (asked.folder / "a.obj").unlink()
    run(options(tmp_path, report_only=True))
    assert (asked.out / "REPORT.md").read_bytes() == before
    assert (asked.out / "run-time.png").stat().st_size > 1000


def test_a_report_alone_does_not_mix_the_rows_of_different_settings(tmp_path: Path) -> None:
    run(options(tmp_path, "a"), open_fake)
    newer = run(options(tmp_path, relief=0.05), open_fake)
    assert [row["key"] for row in run(options(tmp_path, report_only=True))] == [row["key"] for row in newer]
    other_seed = run(options(tmp_path, relief=0.05, seed=1), open_fake)
    assert [row["key"] for row in run(options(tmp_path, report_only=True))] == [row["key"] for row in other_seed]


def test_a_report_without_rows_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeshmarkError) as caught:
        run(options(tmp_path, report_only=True))
    assert caught.value.code is ErrorCode.MISSING_FILE


@pytest.mark.parametrize(
    "wrong", [{"methods": ("magic",)}, {"attacks": (AttackRequest("fire"),)}, {"dataset": "shapenet"}]
)
def test_an_unknown_name_is_refused_before_any_work(tmp_path: Path, wrong: dict[str, object]) -> None:
    with pytest.raises(MeshmarkError) as caught:
        run(options(tmp_path, "a", **wrong), open_fake)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "wrong", [{"counts": ()}, {"counts": (0,)}, {"attack_counts": (7,)}, {"views": 25}, {"processes": 0}]
)
def test_options_that_make_no_sense_are_refused(tmp_path: Path, wrong: dict[str, object]) -> None:
    with pytest.raises(MeshmarkError) as caught:
        options(tmp_path, **wrong)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS


def test_attacks_are_made_at_the_middle_count_unless_named(tmp_path: Path) -> None:
    assert options(tmp_path, counts=(32, 4, 16), attack_counts=()).attacked_counts == (16,)
    assert options(tmp_path, counts=(4, 16, 32), attack_counts=(4, 32)).attacked_counts == (4, 32)


def test_an_attack_is_written_with_its_strength_after_a_colon() -> None:
    assert AttackRequest.parse("remesh:0.25") == AttackRequest("remesh", 0.25)
    assert AttackRequest.parse("crop") == AttackRequest("crop", None)
    with pytest.raises(MeshmarkError):
        AttackRequest.parse("crop:much")


def test_the_environment_of_the_caller_is_left_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(THREADS[0], "7")
    monkeypatch.delenv(THREADS[1], raising=False)
    rows = run(options(tmp_path, "a"), open_fake)
    assert os.environ[THREADS[0]] == "7"
    assert THREADS[1] not in os.environ
    assert "7 a process" not in rows[0]["machine"]
