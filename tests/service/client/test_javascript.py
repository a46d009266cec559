"""The manual's page on JavaScript: its types are those that the site has, and its program does what it says."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from service.manual.build import LIBRARIES, write_types
from tests.manual import ROOT, page
from tests.service.client.conftest import MODEL, Hand
from tests.service.edge import Edge
from tests.worker.engines import asset

EXCERPT, MODULE = re.findall(r"```ts\n(.*?)```", page("javascript"), re.DOTALL)
(PROGRAM,) = re.findall(r"```js\n(.*?)```", page("javascript"), re.DOTALL)
(COMPILE,) = re.findall(r"`npx (tsc .*?)`", page("javascript"))
PACKAGES = ROOT / "tests" / "node_modules"
CLIENT = 'baseUrl: "http://127.0.0.1:8080"'


@pytest.fixture(scope="module")
def folder(edge: Edge, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with the module of the page, compiled."""
    folder = tmp_path_factory.mktemp("javascript")
    write_types(folder / "meshmark.d.ts")
    if not (PACKAGES / "openapi-fetch").is_dir():
        pytest.fail("openapi-fetch is missing: run `npm ci --prefix tests`.", pytrace=False)
    (folder / "node_modules").symlink_to(PACKAGES)
    (folder / "package.json").write_text('{"type": "module"}')
    (folder / "spot.glb").write_bytes(asset(name="spot.glb"))
    (folder / "mark.js").write_text(PROGRAM)
    here = f'baseUrl: "http://127.0.0.1:{edge.port}", headers: {{ Authorization: "Bearer {edge.keys[0]}" }}'
    assert CLIENT in MODULE
    compiled(folder, MODULE.replace(CLIENT, here))
    return folder


def compiled(folder: Path, module: str, refused: bool = False) -> str:
    """What the compiler says."""
    (folder / "watermark.ts").write_text(module)
    run = ["node", LIBRARIES / "typescript" / "bin" / "tsc", *COMPILE.split()[1:], *(["--noEmit"] if refused else [])]
    done = subprocess.run(run, cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode != 0) == refused, done.stdout
    return done.stdout


def run(folder: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(["node", "mark.js"], cwd=folder, capture_output=True, text=True, check=True)


def test_the_lines_that_are_shown_are_among_the_types_and_these_are_as_many_as_is_said(folder: Path) -> None:
    types = (folder / "meshmark.d.ts").read_text()
    assert EXCERPT in types
    for name in ("Parameters", "JobView", "Report", "Problem"):
        assert f"export type {name} = " in types
    (said,) = re.findall(r"some (\d+) kB", page("javascript"))
    assert abs(len(types) / 1000 - int(said)) < 50


def test_versions_are_those_that_are_tested() -> None:
    locks = [json.loads((ROOT / folder / "package.json").read_text()) for folder in ("tests", "service/manual")]
    pinned = locks[0]["dependencies"] | locks[1]["dependencies"]
    named = dict(re.findall(r"([\w-]+)@([\d.]+)", page("javascript")))
    assert named.keys() == {"openapi-fetch", "typescript"}
    assert named.items() <= pinned.items()


def test_the_program_writes_the_watermarked_model(folder: Path, hand: Hand) -> None:
    with hand.working():
        assert run(folder).stderr == ""
    assert (folder / "spot-watermarked.glb").read_bytes() == MODEL


def test_an_error_is_said_with_its_remedy(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path, symlinks=True, dirs_exist_ok=True)
    (tmp_path / "spot.glb").write_bytes(b"")
    assert re.match(r"empty_file: .*\. .*\.$", run(tmp_path).stderr)


def test_what_the_api_does_not_have_is_refused_by_the_compiler(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path, symlinks=True, dirs_exist_ok=True)
    wrong = MODULE.replace("problem.code", "problem.kode").replace("}/model", "}/modell")
    wrong += '\nawait watermark(new Blob(), { text: "a", colour: "#d02020" });\n'
    said = compiled(tmp_path, wrong, refused=True)
    assert all(each in said for each in ("'kode'", '/modell"', "'colour'"))
