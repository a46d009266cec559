import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.config import Settings
from service.jobs import queue
from service.jobs.models import JobState
from worker.sweeper import sweep
from worker.tasks import Worker, scratch_name


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[Worker]:
    settings = Settings(data_dir=tmp_path / "data", lease_seconds=0.05)
    worker = Worker(settings, queue.create_queue(settings), "tests.worker.engines:directed")
    yield worker
    worker.ledger.close()


def create(worker: Worker) -> str:
    return worker.ledger.create("asset.obj", {"text": "HI"}, {}).id


def state(worker: Worker, job_id: str) -> str:
    job = worker.ledger.get(job_id)
    assert job is not None
    return job.error_code or job.state


def test_the_job_of_a_vanished_worker_is_announced_again_and_in_the_end_fails(worker: Worker) -> None:
    job_id = create(worker)
    for attempt in (1, 2):
        assert worker.ledger.claim(job_id, 0.001)
        time.sleep(0.01)
        sweep(worker)
        assert queue.depth(worker.celery) == 1, attempt
    assert state(worker, job_id) == "worker_lost"


def test_a_job_whose_message_was_lost_is_announced_again(worker: Worker) -> None:
    job_id = create(worker)
    sweep(worker)
    assert queue.depth(worker.celery) == 0
    time.sleep(0.06)
    sweep(worker)
    assert queue.depth(worker.celery) == 1
    assert state(worker, job_id) == JobState.QUEUED


def test_a_long_queue_is_not_made_longer(worker: Worker) -> None:
    jobs = [create(worker) for _ in range(3)]
    queue.send(worker.celery, jobs[0])
    time.sleep(0.06)
    for _ in range(3):
        sweep(worker)
    assert queue.depth(worker.celery) == 1


def test_working_folders_of_attempts_that_are_over_are_removed(worker: Worker) -> None:
    job = worker.ledger.claim(create(worker), 60)
    assert job is not None
    mine, old = worker.scratch / scratch_name(job.lease), worker.scratch / "gone.1"
    for folder in (mine, old):
        folder.mkdir()
        (folder / "file").touch()
    sweep(worker)
    assert list(worker.scratch.iterdir()) == [mine]
