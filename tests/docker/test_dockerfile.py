"""The Dockerfile, as far as it can be looked at without building it."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
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


def copies(stage: str) -> list[str]:
    """What a stage takes from others."""
    return re.findall(r"^COPY --from=(.*)", STAGES[stage][1], re.MULTILINE)


def test_both_images_are_a_runtime_without_build_tools_that_runs_as_nobody_in_particular() -> None:
    assert list(STAGES)[-1] == "cpu", "what is built where no target is named"
    for name in ("cpu", "cuda"):
        base, content = STAGES[name]
        assert base == "runtime"
        assert re.findall(r"^(?:RUN|USER)\b.*", content, re.MULTILINE) == []
        assert copies(name) == [f"deps-{name} /opt/meshmark /opt/meshmark", "code /opt/code /opt/meshmark"]
    runtime = STAGES["runtime"][1]
    assert re.findall(r"^USER (.*)", runtime, re.MULTILINE) == ["10001:10001"]
    assert "build-essential" not in runtime
    assert "HEALTHCHECK" in runtime


def test_a_changed_line_of_code_installs_nothing_again() -> None:
    """What packages are installed by depends on their list and on the constraints, and code comes after them."""
    for name in ("cpu", "cuda"):
        base, content = STAGES[f"deps-{name}"]
        assert base == "deps"
        assert re.findall(r"^COPY (.*)", content, re.MULTILINE) == [f"--from=requirements /src/{name}.txt ./"]
    assert re.findall(r"^COPY (.*)", STAGES["requirements"][1], re.MULTILINE) == ["pyproject.toml ./"]
    assert re.findall(r"^COPY (.*)", STAGES["deps"][1], re.MULTILINE) == ["docker/constraints.txt docker/slim.sh ./"]
    code = STAGES["code"][1]
    assert code.count("pip ") == code.count("--no-index") == code.count("--no-deps"), "it needs no network"


def test_versions_are_pinned_and_those_of_the_project() -> None:
    (python,) = re.findall(r"^ARG PYTHON=(.*)", TEXT, re.MULTILINE)
    assert re.fullmatch(r"3\.11\.\d+-slim-\w+", python)
    assert {base for base, _ in STAGES.values()} == {"python:${PYTHON}", "deps", "runtime"}
    (torch,) = re.findall(r"^TORCH := (.*)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert re.findall(r"torch==\S+", TEXT) == [torch, torch]
    constraints = (ROOT / "docker" / "constraints.txt").read_text().splitlines()
    assert torch in constraints
    assert any(line.startswith("setuptools==") for line in constraints)
    before, _, after = TEXT.partition("ENV PIP_CONSTRAINT=/src/constraints.txt")
    assert "pip install" in after, "every one is held by them"
    assert "RUN pip" not in before
    assert SERVICES["api"]["image"].startswith(f"meshmark:{'.'.join(__version__.split('.')[:2])}")


def test_torch_comes_from_an_index_that_can_be_named_and_all_it_needs_from_pips_own() -> None:
    content = STAGES["deps-cpu"][1]
    assert "ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu" in content
    (torch,) = re.findall(r"install ([^\\]*torch==[^\\]*)", content)
    assert torch.split()[0] == "--no-deps"
    assert '${TORCH_INDEX:+--index-url "$TORCH_INDEX"}' in torch
    assert content.count("--index-url") == 1
    assert SERVICES["api"]["build"]["args"] == ["TORCH_INDEX", "WEIGHTS"]


def test_the_list_of_what_is_installed_is_that_of_the_project(tmp_path: Path) -> None:
    (script,) = re.findall(r"^RUN python -c '(.*?)'", STAGES["requirements"][1], re.MULTILINE | re.DOTALL)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    subprocess.run([sys.executable, "-c", script.replace("\\\n", "")], cwd=tmp_path, check=True)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    cpu = [*project["dependencies"], *extras["otel"], *extras["c2pa"]]
    assert (tmp_path / "cpu.txt").read_text().splitlines() == cpu
    assert (tmp_path / "cuda.txt").read_text().splitlines() == [*cpu, *extras["cuda"]]


def test_weights_are_in_the_image_or_the_build_ends_with_the_reason(tmp_path: Path) -> None:
    assert copies("runtime") == ["weights /opt/models /opt/models"]
    content = STAGES["weights"][1]
    for line in re.findall(r"^COPY (.*)", content, re.MULTILINE):
        *sources, target = line.split()
        (tmp_path / target).mkdir(exist_ok=True)
        for source in sources:
            shutil.copy(ROOT / source, tmp_path / target)

    def step(what: str, folder: Path) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-S", "weights.py", what, os.fspath(folder)]
        # A proxy that is none: no test asks the network.
        environment = os.environ | {"PYTHONPATH": ".", "https_proxy": "http://127.0.0.1:9"}
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    without = step("none", tmp_path / "none")
    assert without.returncode == 0
    assert "Built without the weights" in without.stdout
    assert list((tmp_path / "none").iterdir()) == []
    failed = step("fetch", tmp_path / "fetch")
    assert failed.returncode == 1
    assert "could not be downloaded" in failed.stderr
    assert failed.stderr.endswith("To build without weights: --build-arg WEIGHTS=none\n")
    assert "Traceback" not in failed.stderr
    assert step("perhaps", tmp_path / "perhaps").returncode == 1


def test_what_is_taken_out_of_the_image_is_what_nobody_runs(tmp_path: Path) -> None:
    packages = tmp_path / "lib" / "python3.11" / "site-packages"
    kept = {"numpy/core.py", "jinja2/tests.py", "torch/bin/torch_shm_manager", "torch/testing/_core.py"}
    gone = {
        *("numpy/tests/test_a.py", "scipy/fft/tests/data/x.npz", "torch/test/basic", "torch/include/a.h"),
        *("torch/bin/test_jit", "torch/bin/TCPStoreTest", "torch/bin/protoc", "lib64/libembree4.a"),
        *("setuptools/__init__.py", "setuptools-84.2.1.dist-info/METADATA", "distutils-precedence.pth"),
    }
    for name in kept | gone:
        (packages / name).parent.mkdir(parents=True, exist_ok=True)
        (packages / name).touch()
    subprocess.run(["sh", ROOT / "docker" / "slim.sh", tmp_path], check=True)
    left = {path.relative_to(packages).as_posix() for path in packages.rglob("*") if path.is_file()}
    assert left == kept


def test_no_volume_is_declared_that_a_container_would_leave_behind() -> None:
    assert not re.search(r"^VOLUME", TEXT, re.MULTILINE)


def test_the_system_packages_are_those_the_service_needs_elsewhere_too() -> None:
    script = (ROOT / "docker" / "system-packages.sh").read_text()
    needed = re.search(r"service\).*?need ([^;]*);;", script, re.DOTALL)
    fonts = re.findall(r'fonts="\$fonts (.*?)"', script)
    assert needed is not None
    assert fonts
    assert {*needed[1].split(), *fonts} <= set(STAGES["runtime"][1].split())


def test_its_variables_are_settings() -> None:
    named = set(re.findall(r"MESHMARK_\w+(?==)", TEXT))
    assert named == {f"{PREFIX}{name}" for name in ("HOST", "AUTH", "DATA_DIR", "MODELS")}
    settings = named - {f"{PREFIX}MODELS"}  # the engine's own, which the command line has too
    assert {name.removeprefix(PREFIX).lower() for name in settings} <= Settings.model_fields.keys()


def test_the_context_is_the_code_alone_and_enough_to_install_all_of_it(tmp_path: Path) -> None:
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    rules = [line for line in lines if line and not line.startswith("#")]
    assert rules[0] == "*"
    context = {rule.removeprefix("!") for rule in rules if rule.startswith("!")}
    code = {"core", "service", "worker"}
    tools = {"docker/constraints.txt", "docker/slim.sh", "docker/weights.py"}
    assert context - code == {"pyproject.toml", "README.md", "LICENSE", "openapi.yaml", *tools}
    for name in context - tools:
        if name in code:
            left_out = shutil.ignore_patterns("__pycache__", "docs", "node_modules")
            shutil.copytree(ROOT / name, tmp_path / name, ignore=left_out)
        else:
            shutil.copy(ROOT / name, tmp_path)
    there = {path.relative_to(tmp_path).as_posix() for name in code for path in (tmp_path / name).rglob("*.*")}
    build = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, tmp_path], cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        assert there <= set(archive.namelist())
    assert "core/artwork/fonts/DejaVuSans-Bold.ttf" in there
    assert any(path.startswith("service/jobs/migrations/versions/") for path in there)
