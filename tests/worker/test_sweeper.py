import io
import os
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import select, update

from service.config import Settings
from service.jobs import idempotency, queue
from service.jobs.artifacts import GRACE
from service.jobs.clock import now
from service.jobs.ledger import Content
from service.jobs.models import ArtifactKind, IdempotencyKey, Job, JobState, Queue
from service.jobs.ownership import claim
from tests.service.postgres import Postgres
from tests.service.s3 import Bucket, bucket_settings
from tests.service.silent import SilentServer
from tests.worker.waiting import wait_until
from worker.sweeper import start_sweeper, sweep, sweep_store
from worker.tasks import Worker, scratch_name


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[Worker]:
    settings = Settings(data_dir=tmp_path / "data", lease_seconds=60)
    worker = Worker(settings, queue.create_queue(settings), "tests.worker.engines:directed")
    yield worker
    worker.close()


def create(worker: Worker) -> str:
    return worker.ledger.create("asset.obj", {"text": "HI"}, {}, lambda _: True).id


def state(worker: Worker, job_id: str) -> str:
    job = worker.ledger.get(job_id)
    assert job is not None
    return job.error_code or job.state


def wait_an_hour(worker: Worker) -> None:
    """As if all jobs had been announced an hour earlier."""
    with worker.ledger.sessions.begin() as session:
        session.execute(update(Job).values(enqueued_at=now() - timedelta(hours=1)))


def test_the_job_of_a_vanished_worker_is_announced_again_and_in_the_end_fails(worker: Worker) -> None:
    job_id = create(worker)
    for attempt in (1, 2):
        assert worker.ledger.claim(job_id, 0.001)
        time.sleep(0.01)
        sweep(worker)
        assert queue.depth(worker.celery, Queue.SMALL) == 1, attempt
    assert state(worker, job_id) == "worker_lost"


def test_a_key_that_its_client_may_use_again_is_forgotten(worker: Worker, monkeypatch: pytest.MonkeyPatch) -> None:
    for key, held in (("old", 0.0), ("new", 60.0)):
        monkeypatch.setattr(idempotency, "HELD", timedelta(seconds=held))
        idempotency.reserve(worker.ledger.sessions, "default", key, "print")
    time.sleep(0.01)
    sweep(worker)
    with worker.ledger.sessions() as session:
        assert list(session.scalars(select(IdempotencyKey.key))) == ["new"]


def test_a_job_whose_message_was_lost_is_announced_again(worker: Worker) -> None:
    job_id = create(worker)
    sweep(worker)
    assert queue.depth(worker.celery, Queue.SMALL) == 0
    wait_an_hour(worker)
    sweep(worker)
    assert queue.depth(worker.celery, Queue.SMALL) == 1
    assert state(worker, job_id) == JobState.QUEUED


def test_a_long_queue_is_not_made_longer(worker: Worker) -> None:
    jobs = [create(worker) for _ in range(3)]
    queue.send(worker.celery, jobs[0], Queue.SMALL)
    for _ in range(3):
        wait_an_hour(worker)
        sweep(worker)
    assert queue.depth(worker.celery, Queue.SMALL) == 1


def test_working_folders_of_attempts_that_are_over_are_removed(worker: Worker) -> None:
    job = worker.ledger.claim(create(worker), 60)
    assert job is not None
    mine, old = worker.scratch / scratch_name(job.lease), worker.scratch / "gone.1"
    for folder in (mine, old):
        folder.mkdir()
        (folder / "file").touch()
    sweep(worker)
    assert list(worker.scratch.iterdir()) == [mine]


def test_content_that_no_job_refers_to_is_removed_when_it_is_old(worker: Worker) -> None:
    claim(worker.ledger, worker.artifacts)
    with worker.artifacts.stage(io.BytesIO(b"1"), limit=1, name="file") as staged:
        worker.artifacts.put(staged)
        share = int(staged.sha256[:2], 16)
        sweep_store(worker, share)
        assert worker.artifacts.has(staged.sha256)
        os.utime(staged.path, (0, time.time() - GRACE - 1))  # one file under both names
        sweep_store(worker, share + 1)
        assert worker.artifacts.has(staged.sha256)
        sweep_store(worker, share)
        assert not worker.artifacts.has(staged.sha256)


def test_a_store_that_does_not_answer_keeps_no_lost_job_waiting(postgres: Postgres, tmp_path: Path) -> None:
    """Files are to be deleted, and each deletion is waited for."""
    with closing(SilentServer()) as server:
        silent = bucket_settings(Bucket(f"http://{server.address}", "bucket"), tmp_path)
        settings = silent.model_copy(
            update={"database_url": postgres.new_database(), "lease_seconds": 0.2, "retention_seconds": 0.001}
        )
        worker = Worker(settings, queue.create_queue(settings), "tests.worker.engines:directed")
        overdue = {ArtifactKind.INPUT: Content("0" * 64, 1)}
        done = worker.ledger.claim(worker.ledger.create("a.obj", {}, overdue, lambda _: True).id, 60)
        assert done is not None
        assert worker.ledger.succeed(done.lease)
        start_sweeper(worker)
        wait_until(lambda: state(worker, done.id) == JobState.EXPIRED)
        lost = create(worker)
        assert worker.ledger.claim(lost, 0.001)
        wait_until(lambda: state(worker, lost) == JobState.QUEUED)
        worker.stop()
    wait_until(lambda: not any("sweeper" in thread.name for thread in threading.enumerate()))
    worker.ledger.close()
