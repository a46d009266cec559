"""Progress, errors and help as a person or a pipe gets them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from core.cli.app import COMMANDS, main
from core.cli.terminal import printable
from tests.core.cli.terminals import environment, on_terminal, piped
from tests.core.gltf.builder import CUBE, CUBE_FACES, simple

STAGES = ["loading", "reading", "lettering", "placing", "embossing", "writing", "reporting"]
COLOR = re.compile(r"\x1b\[([0-9]+;)*(3[0-8]|9[0-7])(;[0-9]+)*m")  # bold and dim are none


@pytest.fixture
def cube(tmp_path: Path) -> Path:
    path = tmp_path / "cube.glb"
    path.write_bytes(simple(CUBE, CUBE_FACES).to_glb())
    return path


def test_on_a_terminal_a_bar_goes_through_the_stages_and_one_line_stays(cube: Path) -> None:
    status, shown = on_terminal(cube.parent, "apply", "cube.glb", "out.glb", "--text", "a", "--count", "1")
    assert status == 0
    assert "cube.glb" in shown
    assert "━" in shown
    places = [shown.find(stage) for stage in ("loading", "placing")]
    assert -1 < places[0] < places[1]
    assert COLOR.search(shown)
    screen = shown.rpartition("\x1b[2K")[2]  # what is left of it: the bar is gone
    assert re.fullmatch(r"out\.glb: 1 watermark in \d+\.\d s\r\n", screen)


def test_no_color_takes_the_colours_of_errors_and_help_away(tmp_path: Path) -> None:
    asked = ["apply", "none.glb", "out.glb", "--text", "a"]
    status, shown = on_terminal(tmp_path, *asked)
    assert status == 66
    assert COLOR.search(shown)
    for arguments in (asked, ["--help"]):
        status, shown = on_terminal(tmp_path, *arguments, NO_COLOR="1")
        assert status == (66 if arguments == asked else 0)
        assert "meshmark" in shown
        assert not COLOR.search(shown)


def test_in_a_pipe_each_stage_is_a_plain_line(cube: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = cube.with_name("out.glb")
    assert main(["apply", str(cube), str(out), "--text", "a", "--count", "1"]) == 0
    told = capsys.readouterr()
    assert told.err.splitlines() == [f"{cube}: {stage}" for stage in STAGES]
    assert re.fullmatch(rf"{re.escape(str(out))}: 1 watermark in \d+\.\d s\n", told.out)
    assert main(["apply", str(cube), str(out), "--text", "a", "--count", "1", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


def test_standard_input_and_output_carry_the_very_bytes(cube: Path) -> None:
    asked = ["--text", "a", "--count", "1"]
    assert main(["apply", str(cube), str(cube.with_name("out.glb")), *asked]) == 0
    done = piped(cube.parent, "apply", "-", "-", *asked, data=cube.read_bytes())
    assert done.returncode == 0
    assert done.stdout == cube.with_name("out.glb").read_bytes()
    assert done.stderr.decode().splitlines()[-1].startswith("-: 1 watermark in ")
    assert [path.name for path in cube.parent.iterdir() if path.name[0] == "-"] == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["apply", "-", "out.glb", "--text", "a", "--logo", "-"],
        ["apply", "in.glb", "-", "--text", "a", "--report", "-"],
        ["apply", "in.glb", "-", "--text", "a", "--json"],
        ["evaluate", "-", "-", "--report", "r.json"],
        ["apply", "-", "--out", "folder", "--text", "a"],
        ["apply", "a.glb", "--out", "folder", "--report", "-", "--text", "a"],
        ["apply", "a.glb", "b.glb", "c.glb", "--text", "a"],
        ["apply", "in.glb", "out.glb", "--size", "wide", "--text", "a"],
        ["benchmark", "folder", "--out", "out", "--counts", "four"],
        ["aply"],
        [],
    ],
)
def test_wrong_usage_is_told_with_the_way_out_and_status_two(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    told = capsys.readouterr()
    assert "Traceback" not in told.err
    assert told.err.startswith("meshmark: invalid_request: ") if arguments else "apply" in told.out
    assert list(tmp_path.iterdir()) == []


def test_a_fault_of_ours_is_told_as_one_with_its_trace(
    cube: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr("core.pipeline.watermark", broken)
    assert main(["apply", str(cube), "out.glb", "--text", "a"]) == 70
    told = capsys.readouterr().err
    assert "Traceback" in told
    assert "\nmeshmark: internal_error: This case is not handled (ZeroDivisionError: by nothing).\nReport it" in told


def test_interrupted_it_ends_as_shells_expect(
    cube: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("core.pipeline.watermark", interrupted)
    assert main(["apply", str(cube), "out.glb", "--text", "a"]) == 130
    assert capsys.readouterr().err.endswith("meshmark: interrupted\n")


def test_names_in_files_do_not_steer_the_terminal() -> None:
    assert printable("a\x1b[2J\x9b1m\ud800b\nc") == "a\\x1b[2J\\x9b1m\\ud800b\nc"


def test_the_list_of_commands_needs_no_library_of_the_engine() -> None:
    code = "import sys; from core.cli import main; main(['--help']); print([*sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment())
    page, _, loaded = done.stdout.rpartition("\n[")
    assert all(f" {name} " in page for name in COMMANDS)
    assert not {"'torch'", "'numpy'", "'pydantic'"} & set(loaded.strip("]\n").split(", "))


@pytest.mark.parametrize(
    ("line", "values"),
    [
        ("meshmark ver", ["verify"]),
        ("meshmark attack s", ["subdivide", "scale", "smooth"]),
        ("meshmark apply in.glb --strength ", ["discreet", "standard", "strong"]),
        ("meshmark apply --keep", ["--keep-out"]),
    ],
)
def test_the_shell_completes_commands_options_and_their_values(line: str, values: list[str], tmp_path: Path) -> None:
    place = str(len(line.split(" ")) - 1)
    done = piped(tmp_path, _MESHMARK_COMPLETE="complete_bash", COMP_WORDS=line, COMP_CWORD=place)
    assert done.stdout.decode().split() == values
