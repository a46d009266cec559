from pathlib import Path

from service.config import Settings
from worker.factory import create_worker
from worker.webhooks import CONCURRENCY, create_sender


def test_a_message_is_taken_when_there_is_a_free_thread_and_confirmed_when_it_is_done_with(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, worker_concurrency=3)
    for app, threads in ((create_worker(settings), 3), (create_sender(settings), CONCURRENCY)):
        assert (app.conf.worker_pool, app.conf.worker_concurrency) == ("threads", threads)
        assert (app.conf.task_acks_late, app.conf.worker_prefetch_multiplier) == (True, 1)
        assert not app.conf.worker_cancel_long_running_tasks_on_connection_loss
