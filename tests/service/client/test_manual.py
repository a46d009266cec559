"""Every program on the manual's page on the client, and in the README, does what it says against a real service."""

import re
import shutil
from pathlib import Path

import pytest

from service.client import Job
from tests.manual import README, page, rows
from tests.service.client.conftest import MODEL, Hand
from tests.service.edge import Edge
from tests.worker.engines import asset

PROGRAMS = [
    program
    for text in (page("client"), README.read_text())
    for program in re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    if "service.client" in program
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that the programs name, in which they run."""
    for name in ("spot.glb", "suspect.glb"):
        (tmp_path / name).write_bytes(asset(name=name))
    (tmp_path / "empty.glb").touch()
    for path in (tmp_path / "models" / "one.glb", tmp_path / "tests" / "data" / "spot.glb"):
        path.parent.mkdir(parents=True)
        shutil.copy(tmp_path / "spot.glb", path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: f"{len(program)} characters")
def test_a_program_of_the_manual_runs(
    program: str, edge: Edge, hand: Hand, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here, found = re.subn(
        r'Client\("http://127.0.0.1:8080"\)', f'Client("http://127.0.0.1:{edge.port}", {edge.keys[0]!r})', program
    )
    assert found == 1 or "verify_webhook" in program
    with hand.working():
        exec(compile(here, "client.md", "exec"), {"__name__": "__main__"})
    for name in re.findall(r'download\("(.*)"\)', program):
        assert (folder / name).read_bytes() == (MODEL if name.endswith(".glb") else b"<html>")
    if "models" in program:
        assert (folder / "models" / "one.marked.glb").read_bytes() == MODEL
    if "empty.glb" in program:
        assert re.search("^empty_file ", capsys.readouterr().out, re.MULTILINE)  # log lines may stand before it


def test_there_are_programs_for_all_that_the_client_does() -> None:
    together = "\n".join(PROGRAMS)
    for name in (
        "AsyncClient",
        "watermark_all",
        "verify(",
        "upload(",
        "SourceUrl(",
        "batch(",
        "convert(",
        "jobs(",
        "on_progress",
        "MeshmarkProblem",
        "verify_webhook",
    ):
        assert name in together
    named = {name for row in rows("client", "Follow a job") for name in re.findall(r"`(\w+)(?:\(.*?\))?`", row[0])}
    assert named == {name for name in dir(Job) if name[0] != "_"} - {"has_ended", "place", "path_of"}
