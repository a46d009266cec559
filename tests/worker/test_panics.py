"""A worker in which a native library panics ends, and the one that is started for it does its work."""

import os
import sys
from pathlib import Path

import pytest

from service.background import DIED
from tests.service.harness import Service
from tests.worker.waiting import wait_until

EMBEDDED = """
import sys
from service.__main__ import serve
from service.config import Settings
serve(Settings(), [sys.executable, "-c", sys.argv[1]])
"""
WORKER = """
import importlib, sys
from pathlib import Path
class PanicException(BaseException): ...
owner = importlib.import_module({module!r})
*classes, name = {path!r}.split(".")
for each in classes:
    owner = getattr(owner, each)
work = getattr(owner, name)
def panic_once(*arguments):
    try:
        Path({mark!r}).touch(exist_ok=False)
    except FileExistsError:
        return work(*arguments)
    raise PanicException("a runtime in a runtime")
setattr(owner, name, panic_once)
sys.argv = ["worker"]
from tests.worker.apps import app
from worker.__main__ import main
main(app)
"""


@pytest.mark.parametrize(
    ("module", "path", "attempts"), [("worker.tasks", "Worker._attempt", 2), ("worker.sweeper", "remove_expired", 1)]
)
def test_a_worker_that_panics_in_a_job_or_beside_it_is_started_again(
    module: str, path: str, attempts: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    mark = tmp_path / "panicked"
    worker = WORKER.format(module=module, path=path, mark=os.fspath(mark))
    service = Service(tmp_path, lease_seconds="2")
    with service.running([sys.executable, "-c", EMBEDDED, worker]):
        if attempts == 1:
            wait_until(mark.exists)
        job = service.wait_for(service.start_job(), "succeeded")
        assert job["attempts"] == attempts
    logged = capfd.readouterr().err
    assert "PanicException" in logged
    assert f'"exit_code": {DIED}' in logged
