"""Every request that README and manual show as a command is answered as they say, one after the other."""

import json
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import create_autospec, patch

import pytest

from core.pipeline import watermark
from tests.manual import MANUAL, README, ROOT, command_lines
from tests.service.harness import EMBEDDED_COMMAND, Service

PAGES_WITH_PYTHON = [page for page in sorted(MANUAL.glob("*.md")) if "```python" in page.read_text()]
API = "http://127.0.0.1:8080"
SPOT = ROOT / "tests" / "data" / "spot.glb"
UNASKED = re.compile(
    r"/(?:credentials|explanation|export|layers|turntable|poster|preview_model|preview_manifest|copies\.zip)\b"
)  # what a job has only where that was asked for
PAGES = [page for page in (README, *sorted(MANUAL.glob("*.md"))) if API in page.read_text()]


def commands(page: Path) -> list[str]:
    """The command lines of a page that ask the API for something, in their order; lines within quotes belong to one."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in re.split(r"\n(?=\S)", command_lines(block))]
    return [line for line in lines if line.startswith("curl ") and API in line and not UNASKED.search(line)]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("samples"), worker_concurrency="1")
    with service.running(EMBEDDED_COMMAND):
        yield service


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the files that the commands name."""
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    for name in ("model.glb", "suspect.glb"):
        (tmp_path / name).symlink_to(SPOT)
    return tmp_path


def ask(command: str, folder: Path, variables: dict[str, str]) -> str:
    """What a command prints; an answer that is an error fails."""
    shown = command.replace("curl ", "curl --fail-with-body ", 1)
    done = subprocess.run(["bash", "-c", shown], cwd=folder, env=os.environ | variables, capture_output=True, text=True)
    assert done.returncode == 0, (command, done.stdout, done.stderr)
    return done.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_requests_of_a_page_are_answered(page: Path, service: Service, folder: Path) -> None:
    variables = {"ID": service.start_job().rpartition("/")[2]}
    asked = commands(page)
    for command in asked:
        output = ask(command.replace(API, service.url), folder, variables)
        answer = re.search(r"^\{.*\}\s*\Z", output, re.MULTILINE)
        if answer is None:
            continue
        told = json.loads(answer[0])
        if "url" in told and "/v1/uploads" in command:
            variables |= {"UPLOAD": told["id"], "URL": told["url"]}
        elif (links := told.get("links")) and told["state"] == "queued":
            variables["ID"] = told["id"]
            service.wait_for(links["self"], "succeeded")


def test_pages_of_the_manual_show_requests() -> None:
    shown = [command for page in PAGES for command in commands(page)]
    assert len(shown) >= 25
    for path in ("/v1/watermarks ", "/events", "/model", "/v1/uploads", "/v1/verifications "):
        assert any(path in command for command in shown), path


def test_the_python_of_the_manual_calls_what_there_is() -> None:
    blocks = [
        block
        for page in PAGES_WITH_PYTHON
        for block in re.findall(r"^```python\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)
    ]
    engine = [block for block in blocks if "core.pipeline" in block]
    assert engine
    for block in blocks:
        compile(block, "manual", "exec")
    for block in engine:  # by a stand-in that takes what the engine takes
        with patch("core.pipeline.watermark", create_autospec(watermark)) as called:
            exec(block, {"data": b""})
        called.assert_called_once()
