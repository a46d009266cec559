import json
import os
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from io import BytesIO
from pathlib import Path

import pytest

from service.config import Settings
from service.jobs import queue
from service.jobs.ledger import WORKER_LOST, Content
from service.jobs.models import ArtifactKind, Job, JobState
from tests.worker.engines import asset
from tests.worker.waiting import wait_until
from worker.tasks import Worker


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[Worker]:
    settings = Settings(data_dir=tmp_path / "data", lease_seconds=60)
    worker = Worker(settings, queue.create_queue(settings), "tests.worker.engines:directed")
    yield worker
    worker.ledger.close()


def submit(worker: Worker, do: str = "work", **details: object) -> str:
    content = asset(do, **details)
    with (
        worker.artifacts.stage(BytesIO(content), limit=len(content), name="file") as staged,
        worker.artifacts.exclusive(),
    ):
        worker.artifacts.add(staged)
    contents = {ArtifactKind.INPUT: Content(staged.sha256, staged.size)}
    return worker.ledger.create("asset.obj", {"text": "HI"}, contents).id


def job(worker: Worker, job_id: str) -> Job:
    found = worker.ledger.get(job_id)
    assert found is not None
    return found


def in_background(worker: Worker, job_id: str) -> threading.Thread:
    """Run a job in a thread, as the pool does, until its engine is at work."""
    thread = threading.Thread(target=worker.run, args=(job_id,))
    thread.start()
    wait_until(lambda: job(worker, job_id).stage == "placing")
    return thread


def test_a_job_is_run_once_and_its_results_are_kept(worker: Worker) -> None:
    job_id = submit(worker)
    worker.run(job_id)
    done = job(worker, job_id)
    assert (done.state, done.attempts, done.progress) == (JobState.SUCCEEDED, 1, 1)
    model = done.artifact(ArtifactKind.MODEL)
    assert model is not None
    assert worker.artifacts.path(model.sha256).read_bytes() == b"glTF of HI"
    assert list(worker.scratch.iterdir()) == []
    worker.run(job_id)
    again = job(worker, job_id)
    assert (again.attempts, again.finished_at) == (1, done.finished_at)


def test_a_message_about_an_unknown_job_is_dropped(worker: Worker) -> None:
    worker.run("00000000-0000-0000-0000-000000000000")


def test_a_refused_asset_fails_with_the_engines_words(worker: Worker) -> None:
    job_id = submit(worker, "refuse")
    worker.run(job_id)
    failed = job(worker, job_id)
    assert (failed.state, failed.error_code) == (JobState.FAILED, "no_placement")
    assert failed.error_message == "No place on this asset."
    assert list(worker.scratch.iterdir()) == []


@pytest.mark.parametrize(
    ("end", "code"),
    [("segfault", "engine_crashed"), ("run_out_of_memory", "memory_limit"), ("stumble", "internal_error")],
)
def test_a_job_whose_measurement_dies_still_delivers_its_model_and_says_why(
    worker: Worker, end: str, code: str
) -> None:
    job_id = submit(worker, then=end)
    worker.run(job_id)
    done = job(worker, job_id)
    assert done.state == JobState.SUCCEEDED
    report, model = done.artifact(ArtifactKind.REPORT), done.artifact(ArtifactKind.MODEL)
    assert report is not None
    assert model is not None
    metrics = json.loads(worker.artifacts.path(report.sha256).read_bytes())["metrics"]
    assert metrics["ocr"] is None
    assert metrics["missing"]["ocr"]["code"] == code


def test_a_canceled_job_is_stopped_and_stays_canceled(worker: Worker) -> None:
    job_id = submit(worker, "hang")
    thread = in_background(worker, job_id)
    assert worker.ledger.cancel(job_id)
    thread.join(5)
    assert not thread.is_alive()
    assert job(worker, job_id).state == JobState.CANCELED


def test_a_worker_that_lost_its_lease_publishes_nothing(worker: Worker, tmp_path: Path) -> None:
    go = tmp_path / "go"
    job_id = submit(worker, wait_for=os.fspath(go))
    thread = in_background(worker, job_id)
    with closing(sqlite3.connect(worker.settings.data_dir / "ledger.sqlite3")) as database:
        database.execute("UPDATE jobs SET lease_expires_at = '2000-01-01 00:00:00.0'")  # as if silent for long
        database.commit()
    assert worker.ledger.recover(2, WORKER_LOST) == ([job_id], [])
    assert worker.ledger.claim(job_id, 60)
    go.touch()
    thread.join(5)
    taken = job(worker, job_id)
    assert (taken.state, taken.attempts) == (JobState.RUNNING, 2)
    assert [artifact.kind for artifact in taken.artifacts] == [ArtifactKind.INPUT]
    stored = [path for path in worker.artifacts.root.rglob("*") if path.is_file() and path.name != ".lock"]
    assert len(stored) == 1


def test_a_stopping_worker_gives_its_job_back_to_the_queue(worker: Worker) -> None:
    job_id = submit(worker, "hang")
    thread = in_background(worker, job_id)
    worker.stopping.set()
    thread.join(5)
    waiting = job(worker, job_id)
    assert (waiting.state, waiting.attempts, waiting.stage) == (JobState.QUEUED, 0, None)
    assert queue.depth(worker.celery) == 1


def test_an_input_that_vanished_from_the_disk_is_a_failed_job_and_not_a_stuck_one(worker: Worker) -> None:
    job_id = submit(worker)
    source = job(worker, job_id).artifact(ArtifactKind.INPUT)
    assert source is not None
    worker.artifacts.path(source.sha256).unlink()
    worker.run(job_id)
    assert (job(worker, job_id).state, job(worker, job_id).error_code) == (JobState.FAILED, "internal_error")
