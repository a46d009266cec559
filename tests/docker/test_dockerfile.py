"""The Dockerfile, as far as it can be looked at without building it."""

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

from core import __version__
from service.config import PREFIX, Settings
from tests.docker.test_compose import SERVICES

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docker" / "Dockerfile").read_text()
# Stage by stage: its name, what it is based on, its instructions.
STAGES = {
    match[2]: (match[1], match[3])
    for match in re.finditer(r"^FROM (\S+) AS (\S+)\n(.*?)(?=^FROM |\Z)", TEXT, re.MULTILINE | re.DOTALL)
}


def test_both_images_are_a_runtime_without_build_tools_that_runs_as_nobody_in_particular() -> None:
    assert list(STAGES)[-1] == "cpu", "what is built where no target is named"
    for name in ("cpu", "cuda"):
        base, content = STAGES[name]
        assert base == "runtime"
        assert re.findall(r"^(?:RUN|USER)\b.*", content, re.MULTILINE) == []
        assert f"COPY --from=build-{name} /opt/meshmark /opt/meshmark" in content
    runtime = STAGES["runtime"][1]
    assert re.findall(r"^USER (.*)", runtime, re.MULTILINE) == ["10001:10001"]
    assert "build-essential" not in runtime
    assert "HEALTHCHECK" in runtime


def test_versions_are_pinned_and_those_of_the_project() -> None:
    (python,) = re.findall(r"^ARG PYTHON=(.*)", TEXT, re.MULTILINE)
    assert re.fullmatch(r"3\.11\.\d+-slim-\w+", python)
    assert {base for base, _ in STAGES.values()} == {"python:${PYTHON}", "build", "runtime"}
    (torch,) = re.findall(r"^TORCH := (.*)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert re.findall(r"torch==\S+", TEXT) == [torch, torch]
    assert torch in (ROOT / "docker" / "constraints.txt").read_text().splitlines()
    assert TEXT.count("--constraint docker/constraints.txt") == 2
    assert SERVICES["api"]["image"].startswith(f"meshmark:{'.'.join(__version__.split('.')[:2])}")


def test_the_system_packages_are_those_the_service_needs_elsewhere_too() -> None:
    script = (ROOT / "docker" / "system-packages.sh").read_text()
    needed = re.search(r"service\).*?need ([^;]*);;", script, re.DOTALL)
    assert needed is not None
    assert set(needed[1].split()) <= set(STAGES["runtime"][1].split())


def test_its_variables_are_settings() -> None:
    named = set(re.findall(r"MESHMARK_\w+(?==)", TEXT))
    assert named == {f"{PREFIX}{name}" for name in ("HOST", "AUTH", "DATA_DIR")}
    assert {name.removeprefix(PREFIX).lower() for name in named} <= Settings.model_fields.keys()


def test_the_context_is_the_code_alone_and_enough_to_install_all_of_it(tmp_path: Path) -> None:
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    rules = [line for line in lines if line and not line.startswith("#")]
    assert rules[0] == "*"
    context = {rule.removeprefix("!") for rule in rules if rule.startswith("!")}
    code = {"core", "service", "worker"}
    assert context - code == {"pyproject.toml", "README.md", "LICENSE", "docker/constraints.txt"}
    for name in context - {"docker/constraints.txt"}:
        if name in code:
            shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, tmp_path)
    there = {path.relative_to(tmp_path).as_posix() for name in code for path in (tmp_path / name).rglob("*.*")}
    build = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, tmp_path], cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        assert there <= set(archive.namelist())
    assert "core/lettering/fonts/DejaVuSans-Bold.ttf" in there
    assert any(path.startswith("service/jobs/migrations/versions/") for path in there)
