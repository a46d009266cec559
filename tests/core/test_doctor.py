"""`meshmark doctor`: what is there, and what to do about the rest."""

import json
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from core import doctor
from core.cli import main
from core.cli.doctor import GROUP
from core.doctor import State
from core.errors import ErrorCode, MeshmarkError

ROOT = Path(__file__).parents[2]


def test_a_machine_that_runs_the_suite_has_all_that_is_required(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["missing"] == []
    parts = {finding["part"]: finding for finding in told["findings"]}
    assert {"libraries", "OpenGL", "fonts", "GPU", "weights", "disk"} <= {*parts}
    assert all(finding["remedy"] for finding in parts.values() if finding["state"] != "ok")


def test_without_opengl_it_says_what_to_install_and_ends_with_69(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def unavailable(_size: int) -> None:
        raise MeshmarkError(ErrorCode.RENDERING_UNAVAILABLE, "No EGL here.", "Install it.")

    monkeypatch.setattr("core.rendering.renderer.Renderer", unavailable)
    assert main(["doctor"]) == 69
    lines = capsys.readouterr().out.splitlines()
    [place] = [lines.index(line) for line in lines if line.split()[:2] == ["missing", "OpenGL"]]
    assert lines[place].endswith("No EGL here.")
    assert lines[place + 1].strip() == "Install it."
    assert lines[-1] == "Missing: OpenGL."


def test_what_is_optional_is_told_with_its_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHMARK_MODELS", str(tmp_path))
    monkeypatch.setattr("core.doctor.find_spec", lambda _name: None)
    monkeypatch.setattr("core.artwork.installed.packages_for", lambda script: ["fonts-noto-cjk"] * (script == "Hani"))
    monkeypatch.setattr("core.doctor.shutil.disk_usage", lambda _folder: type("Usage", (), {"free": 2**29}))
    [weights] = doctor.weights()
    found = [weights, doctor.credentials(), doctor.fonts(), doctor.space("disk", tmp_path / "not" / "yet")]
    assert [each.state for each in found] == [State.OPTIONAL] * 4
    assert weights.remedy == "meshmark models fetch resnet50-v1-12-int8"
    assert found[1].remedy == "pip install 'meshmark[c2pa]'"
    assert found[2].remedy.startswith("sudo apt-get install fonts-noto-cjk")
    assert found[3].found.startswith("0.5 GiB")


def test_a_device_that_is_named_and_not_there_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MESHMARK_DEVICE", "abacus")
    assert doctor.gpu().state is State.MISSING
    monkeypatch.setenv("MESHMARK_DEVICE", "cpu")
    assert doctor.gpu().state is State.OK


def test_the_findings_of_other_packages_are_named_in_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for target in project["entry-points"][GROUP].values():
        module, _, function = target.partition(":")
        assert callable(getattr(import_module(module), function))
