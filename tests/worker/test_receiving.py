import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from service.config import Settings
from service.jobs.queue import create_queue
from service.webhooks import queue
from tests.service.harness import HEEDING, running
from tests.worker.waiting import PATIENCE, wait_until
from worker.factory import create_worker
from worker.webhooks import CONCURRENCY, create_sender


def test_a_message_is_taken_when_there_is_a_free_thread_and_confirmed_when_it_is_done_with(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, worker_concurrency=3)
    for app, threads in ((create_worker(settings), 3), (create_sender(settings), CONCURRENCY)):
        assert (app.conf.worker_pool, app.conf.worker_concurrency) == ("threads", threads)
        assert (app.conf.task_acks_late, app.conf.worker_prefetch_multiplier) == (True, 1)
        assert not app.conf.worker_cancel_long_running_tasks_on_connection_loss


@pytest.mark.parametrize(
    ("module", "said"), [("worker", "the worker cannot start"), ("worker.webhooks", "metrics cannot be opened")]
)
def test_a_worker_that_cannot_get_ready_ends_and_says_why(module: str, said: str, tmp_path: Path) -> None:
    """Celery logs nothing about it and would go on: without a sign of life, and without the sandbox looked at."""
    (tmp_path / "workers").touch()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        variables = {
            "MESHMARK_DATA_DIR": os.fspath(tmp_path),
            "MESHMARK_WEBHOOKS_METRICS_PORT": str(taken.getsockname()[1]),
        }
        ended = subprocess.run(
            [sys.executable, "-m", module],
            env=os.environ | variables,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
    assert ended.returncode == 2
    assert said in ended.stderr


@pytest.mark.parametrize("ignored", [False, True])
def test_a_terminal_that_closes_ends_a_worker_unless_it_was_told_to_ignore_that(tmp_path: Path, ignored: bool) -> None:
    """Celery would start it anew, in the background."""
    command = [sys.executable, "-m", "worker.webhooks"]
    environment = {"MESHMARK_DATA_DIR": os.fspath(tmp_path)}
    with (
        create_queue(Settings(data_dir=tmp_path)) as broker,
        running([*(["nohup"] if ignored else HEEDING), *command], environment, quiet=True) as process,
    ):
        queue.send(broker, "no such delivery")
        wait_until(lambda: queue.is_empty(broker))  # it was taken: the worker is ready
        process.send_signal(signal.SIGHUP)
        if ignored:
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(1.0)
            process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
