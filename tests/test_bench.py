"""Two commits side by side: intervals of invented figures, the table, and what is told of one that does not run."""

import json
from pathlib import Path

import pytest
import trimesh
import yaml

from tests import bench
from tests.bench import Measurement, Pair, Row, RunError, about, cells, checkout, compared, coverage, git, rank, totals

# An engine that takes no time, with the interfaces that are measured.
ENGINE = {
    "__init__": "",
    "preload": "def preload(): pass",
    "parameters": "parse_parameters = dict",
    "pipeline": """
from types import SimpleNamespace
def watermark(data, parameters, preview):
    return SimpleNamespace(model=data + b"first")
""",
    "cli": """
import sys
from pathlib import Path
def main():
    Path(sys.argv[3]).write_bytes(Path(sys.argv[2]).read_bytes())
""",
}


def measurement(seconds: float, sha256: str = "a") -> Measurement:
    return Measurement(seconds, seconds * 0.75, seconds * 0.25, seconds * 1e8, sha256)


def pairs(*seconds: tuple[float, float]) -> tuple[Pair, ...]:
    return tuple(Pair(measurement(before), measurement(after)) for before, after in seconds)


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """Three commits: an engine, one with other models, one that fails."""
    root = tmp_path / "repository"
    (root / "core").mkdir(parents=True)
    git(root, "init", "--quiet")
    for name, source in ENGINE.items():
        (root / "core" / f"{name}.py").write_text(source)
    commit(root, "first")
    pipeline = root / "core" / "pipeline.py"
    pipeline.write_text(ENGINE["pipeline"].replace("first", "second"))
    commit(root, "second")
    pipeline.write_text("def watermark(data, parameters, preview):\n    raise ValueError('the asset is dull')\n")
    commit(root, "broken")
    return root


def commit(root: Path, name: str) -> None:
    git(root, "add", "--all")
    git(root, "-c", "user.name=A", "-c", "user.email=a@example.com", "commit", "--quiet", "--message", name)
    git(root, "tag", name)


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    folder = tmp_path / "meshes"
    folder.mkdir()
    for name, size in {"small.obj": 1, "medium.obj": 2, "large.obj": 3}.items():
        (folder / name).write_bytes(b"v" * size)
    return folder


def worktrees(repository: Path) -> list[str]:
    return git(repository, "worktree", "list", "--porcelain").split("\n\n")


def test_a_ratio_is_the_median_of_the_pairs_and_not_that_of_the_medians() -> None:
    found = compared(pairs((1, 0.5), (10, 8), (2, 1.8)), "wall")
    assert (found.before, found.after) == (2, 1.8)
    assert (found.ratio, found.low, found.high) == (0.8, 0.5, 0.9)
    assert compared(pairs((4, 2)), "cpu") == bench.Compared(4, 2, 0.5, None, None)


@pytest.mark.parametrize(("runs", "place", "sure"), [(2, 1, 0.5), (5, 1, 0.9375), (6, 1, 0.96875), (9, 2, 0.9609375)])
def test_an_interval_is_as_narrow_as_95_percent_allow_and_says_how_sure_it_is(
    runs: int, place: int, sure: float
) -> None:
    assert rank(runs) == place
    assert coverage(runs, place) == sure
    found = compared(pairs(*((1.0, after) for after in range(1, runs + 1))), "peak")
    assert (found.low, found.high) == (place, runs + 1 - place)
    assert f"{sure:.1%} confidence" in about("a", "b", runs)


def test_a_row_of_the_table_has_seconds_megabytes_ratios_and_whether_bytes_are_the_same() -> None:
    found = cells(Row("cow.glb", "service", pairs((2, 1), (4, 1), (2, 1.5))))
    assert found[:5] == ["cow.glb", "service", "2.000", "1.000", "0.500 [0.250, 0.750]"]
    assert found[8:] == ["200.0", "100.0", "0.500 [0.250, 0.750]", "yes"]
    assert len(found) == len(bench.HEADER)
    assert cells(Row("cow.glb", "apply", pairs((2, 1))))[4] == "0.500"


@pytest.mark.parametrize(
    ("hashes", "said"),
    [
        (["a", "a"], "yes"),
        (["a", "b"], "no"),
        (["a", "a", "a", "b"], "varies after"),
        (["a", "a", "b", "a"], "varies before"),
    ],
)
def test_models_are_the_same_where_all_runs_make_the_same_bytes(hashes: list[str], said: str) -> None:
    before, after = ([measurement(1, each) for each in hashes[side::2]] for side in (0, 1))
    assert bench.same_bytes([Pair(*pair) for pair in zip(before, after, strict=True)]) == said


def test_all_assets_together_are_summed_run_by_run_without_those_that_failed() -> None:
    rows = [
        Row("a", "service", pairs((1, 2), (3, 3))),
        Row("b", "service", failure="after: status 1"),
        Row("c", "service", pairs((3, 2), (5, 1))),
        Row("a", "apply", pairs((1, 1), (1, 1))),
    ]
    (found,) = totals(rows)
    assert (found.asset, found.case) == ("all 2", "service")
    assert [(pair.before.wall, pair.after.wall) for pair in found.pairs] == [(4, 4), (8, 4)]
    assert [pair.before.peak for pair in found.pairs] == [3e8, 5e8]


def test_commits_are_compared_in_worktrees_that_are_gone_afterwards(
    repository: Path, meshes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = tmp_path / "bench.json"
    arguments = ["first", "--after", "second", "--meshes", str(meshes), "--runs", "1", "--json", str(told)]
    assert bench.main(arguments, repository) == 0
    rows = [line.strip("| ").split(" | ") for line in capsys.readouterr().out.splitlines()[2:] if line.startswith("|")]
    both, all_three = ("apply", "service"), ("apply", "service", "metrics")
    expected = [("small.obj", case) for case in all_three] + [("medium.obj", case) for case in both]
    expected += [("large.obj", case) for case in all_three]
    expected += [("all 3", "apply"), ("all 3", "service"), ("all 2", "metrics")]
    assert [(row[0], row[1]) for row in rows] == expected
    assert all(row[-1] == ("yes" if row[1] == "apply" else "no") for row in rows)
    written = json.loads(told.read_text())
    assert written["schema"] == bench.SCHEMA
    assert [(row["asset"], row["case"]) for row in written["rows"]] == expected
    assert all(row["cpu"]["ratio"] > 0 for row in written["rows"])
    assert len(worktrees(repository)) == 1


def test_a_commit_that_does_not_run_is_told_with_its_words_and_the_others_go_on(
    repository: Path, meshes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bench.main(["first", "--meshes", str(meshes), "--only", "small", "--runs", "1"], repository) == 1
    applied, *failed = capsys.readouterr().out.splitlines()[2:5]
    assert applied.endswith("| yes |")
    assert all("failed: after: status 1: ValueError: the asset is dull" in line for line in failed)
    assert len(worktrees(repository)) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing"], "bench: git worktree: fatal: invalid reference: nothing\n"),
        (["first", "--only", "horse"], "has a name that starts with horse\n"),
    ],
)
def test_a_commit_or_a_file_that_is_not_there_is_told_in_one_line(
    arguments: list[str], said: str, repository: Path, meshes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bench.main([*arguments, "--meshes", str(meshes)], repository) == 1
    assert capsys.readouterr().err.endswith(said)


@pytest.mark.parametrize("end", [KeyboardInterrupt, RunError, SystemExit])
def test_a_worktree_is_gone_after_an_interrupt(end: type[BaseException], repository: Path) -> None:
    def used() -> None:
        with checkout(repository, "first") as tree:
            assert (tree / "core" / "cli.py").is_file()
            (tree / "left").touch()
            raise end

    with pytest.raises(end):
        used()
    assert len(worktrees(repository)) == 1


def test_a_tree_without_the_engine_is_not_mistaken_for_the_installed_one(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=f"instead of {tmp_path}"):
        bench.own_code(tmp_path)


def test_a_pull_request_keeps_its_table_and_no_limit_of_time_fails_it() -> None:
    makefile = (bench.ROOT / "Makefile").read_text()
    assert "python -m tests.bench $(BEFORE)" in makefile
    job = yaml.safe_load((bench.ROOT / ".github" / "workflows" / "ci.yaml").read_text())["jobs"]["bench"]
    assert "pull_request" in job["if"]
    assert "make --silent bench BEFORE=" in json.dumps(job["steps"])
    assert job["steps"][-1]["uses"].startswith("actions/upload-artifact")
    assert not any("timeout-minutes" in each for each in (job, *job["steps"]))


def test_the_command_and_the_service_are_measured_on_the_same_work(tmp_path: Path) -> None:
    """By the engine itself."""
    box = tmp_path / "box.stl"
    trimesh.creation.box().export(box)
    applied, served = bench.apply(bench.ROOT, box), bench.job(bench.ROOT, box, evaluate="none")
    assert applied.sha256 == served.sha256
    assert all(each.cpu > 0 < each.wall and each.peak > 1e7 for each in (applied, served))
