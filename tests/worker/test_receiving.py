import os
import subprocess
import sys
from pathlib import Path

import pytest

from service.config import Settings
from tests.worker.waiting import PATIENCE
from worker.factory import create_worker
from worker.webhooks import CONCURRENCY, create_sender


def test_a_message_is_taken_when_there_is_a_free_thread_and_confirmed_when_it_is_done_with(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, worker_concurrency=3)
    for app, threads in ((create_worker(settings), 3), (create_sender(settings), CONCURRENCY)):
        assert (app.conf.worker_pool, app.conf.worker_concurrency) == ("threads", threads)
        assert (app.conf.task_acks_late, app.conf.worker_prefetch_multiplier) == (True, 1)
        assert not app.conf.worker_cancel_long_running_tasks_on_connection_loss


@pytest.mark.parametrize(("module", "in_the_way"), [("worker", "workers"), ("worker.webhooks", "ledger.sqlite3-wal")])
def test_a_worker_that_cannot_get_ready_ends_and_says_why(module: str, in_the_way: str, tmp_path: Path) -> None:
    """Celery logs nothing about it and would go on: without a sign of life, and without the sandbox looked at."""
    (tmp_path / in_the_way).mkdir(mode=0o500)
    if in_the_way == "workers":
        (tmp_path / in_the_way).rmdir()
        (tmp_path / in_the_way).touch()
    ended = subprocess.run(
        [sys.executable, "-m", module],
        env=os.environ | {"MESHMARK_DATA_DIR": os.fspath(tmp_path)},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert ended.returncode == 2
    assert "the worker cannot start" in ended.stderr
