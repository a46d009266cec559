"""Many files in one call of `meshmark apply`."""

import csv
import json
import os
import re
import signal
from pathlib import Path

import pytest

from core.cli.app import main
from core.cli.batch import Folders, orders
from core.cli.order import Order, Outcome, Style
from core.cli.pool import mark_all
from core.cli.progress import Progress
from core.cli.texts import read_texts
from core.errors import ErrorCode, MeshmarkError
from core.gltf.scene import scene_of
from core.parameters import Parameters
from tests.core.cli.terminals import on_terminal, piped
from tests.core.gltf.builder import CUBE, CUBE_FACES, simple


@pytest.fixture
def inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two good files, a damaged one, and what is no model."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "in"
    (folder / "deep").mkdir(parents=True)
    for name in ("b.glb", "deep/a.glb"):
        (folder / name).write_bytes(simple(CUBE, CUBE_FACES).to_glb())
    (folder / "broken.stl").write_bytes(b"solid nothing")
    (folder / "notes.txt").write_text("no model")
    return folder


def named(*paths: str, out: str = "out") -> list[tuple[str, str]]:
    made = orders(map(Path, paths), Folders(Path(out)))
    return [(str(order.input), str(order.output)) for order in made]


def test_a_folder_is_marked_file_by_file_and_one_that_fails_stops_no_other(inputs: Path) -> None:
    asked = ["apply", "in", "none.glb", "--out", "out", "--report", "reports", "--text", "a", "--count", "1"]
    done = piped(inputs.parent, *asked, "--evaluate", "none", "--jobs", "2", "--json")
    assert done.returncode == 1
    files = json.loads(done.stdout)["files"]
    assert [(file["input"], file["output"], file["outcome"], file["watermarks"]) for file in files] == [
        ("in/b.glb", "out/b.glb", "done", 1),
        ("in/broken.stl", None, "failed", 0),
        ("in/deep/a.glb", "out/deep/a.glb", "done", 1),
        ("none.glb", None, "failed", 0),
    ]
    assert [file["error"] and file["error"]["code"] for file in files] == [None, "unknown_format", None, "missing_file"]
    assert len(scene_of(Path("out/deep/a.glb").read_bytes()).surface.faces) > len(CUBE_FACES)
    assert json.loads(Path("reports/deep/a.json").read_text())["watermarks"]
    assert {path.name for path in Path("out").rglob("*") if path.is_file()} == {"a.glb", "b.glb"}
    told = done.stderr.decode().splitlines()
    assert len([line for line in told if line.startswith(("1/4 ", "2/4 ", "3/4 ", "4/4 "))]) == 4
    assert "meshmark: missing_file: none.glb cannot be read: No such file or directory." in told


def test_on_a_terminal_a_table_stays(inputs: Path) -> None:
    asked = ["--text", "a", "--count", "1"]
    status, shown = on_terminal(inputs.parent, "apply", "in/broken.stl", "in/b.glb", "-o", "out", *asked)
    assert status == 1
    assert "loading" in shown
    assert "embossing" in shown
    table = shown.rpartition("outcome")[2]
    assert re.search(r"in/broken\.stl .*failed: unknown_format.*\n *in/b\.glb +\d+ +\d+\.\d .*out/b\.glb", table)
    assert "1 of 2 files marked, 1 failed" in table


@pytest.mark.usefixtures("inputs")
def test_results_lie_as_the_inputs_do_in_the_order_of_their_names() -> None:
    below = [("in/b.glb", "out/b.glb"), ("in/broken.stl", "out/broken.glb"), ("in/deep/a.glb", "out/deep/a.glb")]
    assert named("in") == below
    assert named("in/deep", "in/b.glb") == [("in/deep/a.glb", "out/a.glb"), ("in/b.glb", "out/b.glb")]
    assert named("in/**/*.glb") == [below[0], below[2]]
    assert named("in/b.glb", "in", "in/../in/b.glb") == below
    assert named("none.glb") == [("none.glb", "out/none.glb")]


def test_what_was_written_before_is_no_input(inputs: Path) -> None:
    (inputs / "out").mkdir()
    (inputs / "out" / "b.glb").write_bytes(b"of the last call")
    assert len(named("in", out="in/out")) == 3


def test_no_two_results_have_one_name(inputs: Path) -> None:
    for name in ("b.obj", "B.ply"):
        (inputs / name).write_text("")
    assert named("in/b.glb", "in/b.obj", "in/B.ply", "in/broken.stl") == [
        ("in/b.glb", "out/b.glb.glb"),
        ("in/b.obj", "out/b.obj.glb"),
        ("in/B.ply", "out/B.ply.glb"),
        ("in/broken.stl", "out/broken.glb"),
    ]
    (inputs / "deep" / "b.glb").write_text("")
    with pytest.raises(MeshmarkError, match=r"b\.glb and b\.glb would have the same name") as caught:
        named("in/b.glb", "in/deep/b.glb")
    assert caught.value.code is ErrorCode.INVALID_REQUEST


@pytest.mark.parametrize(
    ("paths", "out", "code"),
    [
        (["in/b.glb"], "in", "invalid_request"),
        (["-"], "out", "invalid_request"),
        (["in/*.fbx"], "out", "missing_file"),
        (["empty"], "out", "missing_file"),
        (["in/b.glb"], "in/notes.txt", "output_not_writable"),
    ],
)
def test_nothing_is_begun_where_not_all_can_be(
    paths: list[str], out: str, code: str, inputs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (inputs.parent / "empty").mkdir()
    before = {path: path.stat().st_mtime_ns for path in inputs.rglob("*")}
    assert main(["apply", *paths, "--out", out, "--text", "a"]) in (2, 66, 73)
    assert capsys.readouterr().err.startswith(f"meshmark: {code}: ")
    assert {path: path.stat().st_mtime_ns for path in inputs.rglob("*")} == before


def test_a_process_that_dies_takes_no_other_file_with_it(inputs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def mark(order: Order, _style: Style, _tell: Progress) -> Outcome:
        if order.input.name == "broken.stl":
            os.kill(os.getpid(), signal.SIGKILL)
        if order.input.name == "a.glb":
            raise ZeroDivisionError
        return Outcome(order, watermarks=7)

    monkeypatch.setattr("core.cli.pool.mark", mark)
    monkeypatch.setattr("core.preload.preload", lambda: None)
    monkeypatch.setattr("core.process.before_children", lambda _threads: None)
    style = Style(Parameters(text="a"), None, None)
    outcomes = mark_all(orders([inputs], Folders(Path("out"))), style, 3, quiet=True)
    assert [outcome.watermarks for outcome in outcomes] == [7, 0, 0]
    assert [outcome.error and outcome.error.code for outcome in outcomes] == [
        None,
        ErrorCode.ENGINE_CRASHED,
        ErrorCode.INTERNAL_ERROR,
    ]
    assert outcomes[1].error is not None
    assert "SIGKILL" in outcomes[1].error.message
    assert "ZeroDivisionError" in outcomes[2].trace


@pytest.fixture
def listed(inputs: Path) -> Path:
    """A list of three texts, one of which no font has letters for."""
    path = inputs.parent / "orders.csv"
    path.write_text('text,customer\nORDER-1,Ann\n"B/2: x y","Lee, Bo"\n\N{UNICORN FACE},Cy\n')
    return path


@pytest.mark.usefixtures("listed")
def test_each_line_of_a_list_has_its_own_copy_and_an_index_says_which(inputs: Path) -> None:
    asked = ["apply", "in/b.glb", "in/broken.stl", "-o", "out", "--report", "reports", "--copies", "orders.csv"]
    done = piped(inputs.parent, *asked, "--count", "1", "--evaluate", "none", "--json")
    assert done.returncode == 1
    assert {path.name for path in Path("out").iterdir()} == {"b-1-ORDER-1.glb", "b-2-B-2-x-y.glb", "copies.csv"}
    with Path("out/copies.csv").open(newline="") as file:
        index = [*csv.DictReader(file)]
    assert [(row["text"], row["customer"], row["input"], row["output"], row["error"]) for row in index] == [
        ("ORDER-1", "Ann", "in/b.glb", "out/b-1-ORDER-1.glb", ""),
        ("B/2: x y", "Lee, Bo", "in/b.glb", "out/b-2-B-2-x-y.glb", ""),
        ("\N{UNICORN FACE}", "Cy", "in/b.glb", "", "missing_glyphs"),
        ("ORDER-1", "Ann", "in/broken.stl", "", "unknown_format"),
        ("B/2: x y", "Lee, Bo", "in/broken.stl", "", "unknown_format"),
        ("\N{UNICORN FACE}", "Cy", "in/broken.stl", "", "unknown_format"),
    ]
    reports = [json.loads(Path(f"reports/b-{name}.json").read_text()) for name in ("1-ORDER-1", "2-B-2-x-y")]
    assert [report["watermarks"][0]["text"] for report in reports] == ["ORDER-1", "B/2: x y"]
    assert len(json.loads(done.stdout)["files"]) == 4


LISTS = {
    "nothing": ("", "a column `text`"),
    "no column of texts": ("name\nAnn\n", "a column `text`"),
    "a column twice": ("text,a,a\nx,1,2\n", "none twice"),
    "a column of the results": ("text,output\nx,y\n", "none of those of results"),
    "no line": ("text\n", "0 lines"),
    "too many lines": ("text\n" + "".join(f"{n}\n" for n in range(1001)), "1,001 lines"),
    "a short line": ("text,a\nx\n", "1 columns for copy 1"),
    "a text twice": ("text\nx\ny\n x \n", "in the copies 1 and 3"),
    "an empty text": ('text,a\nx,1\n" ",2\n', "Copy 2 of texts.csv"),
    "a text without end": ("text\n" + "x" * 201 + "\n", "Copy 1 of texts.csv"),
    "an open quote": ('text\n"x\n', "cannot be read as CSV"),
    "no text at all": ("text\n\xff", "cannot be read as CSV"),
}


@pytest.mark.parametrize(("content", "said"), LISTS.values(), ids=LISTS.keys())
def test_a_list_of_texts_that_is_none_is_refused_before_any_work(
    content: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("texts.csv").write_bytes(content.encode("latin-1"))
    with pytest.raises(MeshmarkError, match=said):
        read_texts(Path("texts.csv"), Parameters(), logo=False)


@pytest.mark.usefixtures("listed")
@pytest.mark.parametrize("asked", [["in/b.glb", "out.glb"], ["in", "-o", "out", "--text", "a"]])
def test_copies_have_a_folder_and_no_other_text(asked: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["apply", *asked, "--copies", "orders.csv"]) == 2
    assert "`--copies` goes with `--out`" in capsys.readouterr().err
