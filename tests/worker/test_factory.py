from pathlib import Path

import pytest

from service.config import Settings
from service.jobs.queue import create_queue
from worker import sandbox
from worker.factory import require_sandbox
from worker.tasks import Worker


def worker_with(folder: Path, mode: str) -> Worker:
    settings = Settings(data_dir=folder, sandbox=mode)
    return Worker(settings, create_queue(settings), "tests.worker.engines:directed")


def test_a_worker_starts_where_the_engine_can_be_shut_in(tmp_path: Path) -> None:
    worker = worker_with(tmp_path, "required")
    require_sandbox(worker)
    worker.close()


def test_where_it_cannot_a_worker_starts_only_if_that_is_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sandbox, "probe", lambda *_: {"files": False, "network": True})  # as on an old kernel
    lenient, strict = worker_with(tmp_path, "auto"), worker_with(tmp_path, "required")
    require_sandbox(lenient)
    with pytest.raises(SystemExit) as ended:
        require_sandbox(strict)
    assert ended.value.code == 2
    assert "cannot shut the engine off from: files" in capsys.readouterr().err
    for worker in (lenient, strict):
        worker.close()
