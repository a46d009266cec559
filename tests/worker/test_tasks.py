import errno
import json
import os
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from io import BytesIO
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from service.config import SECRETS, Settings
from service.jobs import contents, queue
from service.jobs.dead import WORKER_LOST
from service.jobs.forgetting import drop_artifacts
from service.jobs.models import Artifact, ArtifactKind, Job, JobState, Queue
from tests.service.s3 import S3, Flaky, bucket_settings
from tests.worker.engines import asset
from tests.worker.waiting import PATIENCE, wait_until
from worker.tasks import Worker, private_folders


def worker_with(settings: Settings) -> Worker:
    return Worker(settings, queue.create_queue(settings), "tests.worker.engines:directed")


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[Worker]:
    worker = worker_with(Settings(data_dir=tmp_path / "data", lease_seconds=60))
    yield worker
    worker.close()


def submit(worker: Worker, do: str = "work", **details: object) -> str:
    content = asset(do, **details)
    with worker.artifacts.stage(BytesIO(content), limit=len(content), name="file") as staged:
        staged_as = {ArtifactKind.INPUT: staged}
        return contents.create_job(worker.ledger, worker.artifacts, "asset.obj", {"text": "HI"}, staged_as).id


def content(worker: Worker, artifact: Artifact | None) -> bytes:
    assert artifact is not None
    return b"".join(worker.artifacts.read(artifact.sha256, 0, artifact.size))


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
    assert content(worker, done.artifact(ArtifactKind.MODEL)) == b"glTF of HI"
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
    assert done.artifact(ArtifactKind.MODEL) is not None
    metrics = json.loads(content(worker, done.artifact(ArtifactKind.REPORT)))["metrics"]
    assert metrics["ocr"] is None
    assert metrics["missing"]["ocr"]["code"] == code


def test_a_job_whose_engine_dies_after_its_last_report_is_done(worker: Worker) -> None:
    job_id = submit(worker, at_the_end="segfault")
    worker.run(job_id)
    done = job(worker, job_id)
    assert done.state == JobState.SUCCEEDED
    report = json.loads(content(worker, done.artifact(ArtifactKind.REPORT)))
    assert report["metrics"] == {"ocr": 1.0, "missing": {}}


@pytest.mark.parametrize("report", [[], {}, {"metrics": 1}, {"metrics": {"ocr": 1.0}}, {"metrics": {"missing": 3}}])
def test_an_engine_that_dies_and_leaves_what_is_no_report_has_crashed(worker: Worker, report: object) -> None:
    job_id = submit(worker, at_the_end="segfault", report=report)
    worker.run(job_id)
    assert (job(worker, job_id).state, job(worker, job_id).error_code) == (JobState.FAILED, "engine_crashed")


def test_a_job_whose_report_the_disk_has_no_room_for_is_put_back(
    worker: Worker, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill(_path: Path, _content: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    job_id = submit(worker, then="segfault")
    monkeypatch.setattr("worker.tasks.replace_result", fill)
    worker.run(job_id)
    assert job(worker, job_id).state == JobState.QUEUED
    monkeypatch.undo()
    worker.run(job_id)
    assert job(worker, job_id).state == JobState.SUCCEEDED


def test_a_canceled_job_is_stopped_and_stays_canceled(worker: Worker) -> None:
    job_id = submit(worker, "hang")
    thread = in_background(worker, job_id)
    assert worker.ledger.cancel(job_id)
    thread.join(PATIENCE)
    assert not thread.is_alive()
    assert job(worker, job_id).state == JobState.CANCELED


def test_a_job_can_be_canceled_while_it_waits_and_when_its_model_is_there(worker: Worker, tmp_path: Path) -> None:
    waits, measures = submit(worker), submit(worker, wait_for_before_the_report=os.fspath(tmp_path / "never"))
    assert worker.ledger.cancel(waits)
    thread = threading.Thread(target=worker.run, args=(waits,))  # its message starts the other one
    thread.start()
    wait_until(lambda: job(worker, measures).stage == "evaluating")
    assert worker.ledger.cancel(measures)
    thread.join(PATIENCE)
    assert not thread.is_alive()
    assert [job(worker, each).state for each in (waits, measures)] == [JobState.CANCELED] * 2
    assert job(worker, waits).attempts == 0
    assert list(worker.scratch.iterdir()) == []


def test_a_job_may_end_within_the_time_that_a_stopping_worker_has(worker: Worker, tmp_path: Path) -> None:
    go = tmp_path / "go"
    job_id, later = submit(worker, wait_for=os.fspath(go)), submit(worker, number=2)
    thread = in_background(worker, job_id)
    worker.settings.shutdown_seconds = PATIENCE
    worker.stop()
    worker.run(later)  # a message that had come already
    go.touch()
    thread.join(PATIENCE)
    assert [job(worker, each).state for each in (job_id, later)] == [JobState.SUCCEEDED, JobState.QUEUED]
    assert queue.depth(worker.celery, Queue.SMALL) == 1


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
    thread.join(PATIENCE)
    taken = job(worker, job_id)
    assert (taken.state, taken.attempts) == (JobState.RUNNING, 2)
    assert [artifact.kind for artifact in taken.artifacts] == [ArtifactKind.INPUT]
    assert len(list(worker.artifacts.listing())) == 1


def test_a_stopping_worker_gives_its_job_back_to_the_queue(worker: Worker) -> None:
    job_id = submit(worker, "hang")
    thread = in_background(worker, job_id)
    worker.settings.shutdown_seconds = 0
    worker.stop()
    thread.join(PATIENCE)
    waiting = job(worker, job_id)
    assert (waiting.state, waiting.attempts, waiting.stage) == (JobState.QUEUED, 0, None)
    assert queue.depth(worker.celery, Queue.SMALL) == 1


def test_an_input_that_vanished_from_the_store_is_a_failed_job_and_not_a_stuck_one(worker: Worker) -> None:
    job_id = submit(worker)
    source = job(worker, job_id).artifact(ArtifactKind.INPUT)
    assert source is not None
    worker.artifacts.remove(source.sha256)
    worker.run(job_id)
    assert (job(worker, job_id).state, job(worker, job_id).error_code) == (JobState.FAILED, "internal_error")


@pytest.mark.parametrize("kind", [ArtifactKind.INPUT, ArtifactKind.FONT])
def test_a_job_that_is_deleted_between_its_claim_and_its_fetch_is_given_up_without_an_error(
    worker: Worker, kind: ArtifactKind, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        worker.artifacts.stage(BytesIO(asset()), limit=1000, name="file") as file,
        worker.artifacts.stage(BytesIO(b"font"), limit=1000, name="font") as font,
    ):
        staged = {ArtifactKind.INPUT: file, ArtifactKind.FONT: font}
        job_id = contents.create_job(worker.ledger, worker.artifacts, "asset.obj", {"text": "HI"}, staged).id
    fetch = worker.artifacts.fetch

    def delete_and_fetch(sha256: str, size: int, target: Path) -> None:
        if target.name == kind:
            worker.ledger.cancel(job_id)
            contents.discard(worker.ledger, worker.artifacts, drop_artifacts(worker.ledger.sessions, job_id))
        fetch(sha256, size, target)

    monkeypatch.setattr(worker.artifacts, "fetch", delete_and_fetch)
    with capture_logs() as lines:
        worker.run(job_id)
    assert job(worker, job_id).state == JobState.CANCELED
    assert [line["event"] for line in lines if line["log_level"] in ("error", "critical")] == []
    assert lines[-1]["event"].startswith("job given up")


def test_a_store_that_fails_for_a_while_delays_a_job_and_does_not_end_it(s3: S3, tmp_path: Path) -> None:
    """It fails when the input is fetched, and again when the model is published; the lease is far shorter."""
    with Flaky(s3.url).running() as flaky:
        bucket, go = s3.new_bucket(), tmp_path / "go"
        bucket.endpoint = flaky.url
        worker = worker_with(bucket_settings(bucket, tmp_path / "data", lease_seconds=1))
        job_id = submit(worker, wait_for=os.fspath(go))
        flaky.failing.set()
        thread = threading.Thread(target=worker.run, args=(job_id,))
        thread.start()
        wait_until(lambda: flaky.failed)
        flaky.failing.clear()
        wait_until(lambda: job(worker, job_id).stage == "placing")
        flaky.failing.set()
        before = flaky.failed
        go.touch()
        wait_until(lambda: flaky.failed > before + 3)
        assert worker.ledger.recover(1, WORKER_LOST) == ([], [])  # the lease was kept all the while
        flaky.failing.clear()
        thread.join(PATIENCE)
        done = job(worker, job_id)
        assert (done.state, done.attempts) == (JobState.SUCCEEDED, 1)
        assert content(worker, done.artifact(ArtifactKind.MODEL)) == b"glTF of HI"
        worker.close()


def test_a_job_is_put_back_when_the_engine_finds_the_disk_full(worker: Worker) -> None:
    job_id = submit(worker, "find_disk_full")
    worker.run(job_id)
    waiting = job(worker, job_id)
    assert (waiting.state, waiting.attempts, waiting.error_code) == (JobState.QUEUED, 0, None)
    assert list(worker.scratch.iterdir()) == []


def test_a_job_is_put_back_when_the_store_fails_for_longer_than_a_worker_waits(
    s3: S3, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("worker.tasks.RETRY_SECONDS", 0.5)
    with Flaky(s3.url).running() as flaky:
        bucket = s3.new_bucket()
        bucket.endpoint = flaky.url
        worker = worker_with(bucket_settings(bucket, tmp_path / "data", lease_seconds=60))
        job_id = submit(worker)
        flaky.failing.set()
        worker.run(job_id)
        waiting = job(worker, job_id)
        assert (waiting.state, waiting.attempts) == (JobState.QUEUED, 0)
        assert list(worker.scratch.iterdir()) == []
        flaky.failing.clear()
        worker.run(job_id)
        assert job(worker, job_id).state == JobState.SUCCEEDED
        worker.close()


def test_the_engine_does_not_see_a_ledger_outside_the_data_folder_either(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", database_url=f"sqlite:///{tmp_path / 'jobs.sqlite3'}")
    assert {tmp_path / "data", tmp_path / "jobs.sqlite3", tmp_path / "jobs.sqlite3-wal"} <= set(
        private_folders(settings)
    )
    servers = Settings(data_dir=tmp_path, database_url="postgresql://user@host/jobs")
    assert private_folders(servers) == (tmp_path, SECRETS)
    token, hooks = tmp_path / "token", tmp_path / "hooks.toml"
    token.write_text("0123456789abcdef")
    example = Path(__file__).parents[2] / "docker" / "hooks.example.toml"
    hooks.write_text(example.read_text().replace('token = "change-me-0123456789abcdef"', f'token_file = "{token}"'))
    assert private_folders(servers.model_copy(update={"hooks_file": hooks})) == (tmp_path, SECRETS, hooks, token)


@pytest.mark.parametrize("do", ["link_instead", "pipe_instead"])
@pytest.mark.parametrize("when", ["do", "then"])
def test_an_engine_that_leaves_no_files_but_ways_elsewhere_gets_nothing_published(
    do: str, when: str, worker: Worker, tmp_path: Path
) -> None:
    """It was taken over, and cannot read the data folder itself; the worker can. `then` is after a first report."""
    private = tmp_path / "data" / "secret"
    private.write_text(secret := '{"metrics": {"missing": {}}}')
    order = {"do": do} if when == "do" else {"do": "work", "then": do}
    job_id = submit(worker, **order, private=os.fspath(private))
    thread = threading.Thread(target=worker.run, args=(job_id,), daemon=True)
    thread.start()
    thread.join(PATIENCE)
    assert not thread.is_alive(), "it waits for somebody to write into the pipe"
    published = [content(worker, item) for item in job(worker, job_id).artifacts if item.kind != ArtifactKind.INPUT]
    assert secret.encode() not in published
    if when == "do":
        assert (job(worker, job_id).error_code, published) == ("engine_crashed", [])
    assert private.read_text() == secret
