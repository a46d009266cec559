import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta

import pytest
from sqlalchemy.orm import Session

from core.errors import ErrorCode, MeshmarkError
from service.jobs import events
from service.jobs.clock import now
from service.jobs.dead import WORKER_LOST
from service.jobs.events import forget, read
from service.jobs.forgetting import drop_artifacts
from service.jobs.ledger import Ledger, Submission
from service.jobs.models import EventType, JobState

BROKEN = MeshmarkError(ErrorCode.NO_FACES, "It has no faces.", "Add some.")


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


def create(ledger: Ledger) -> str:
    return ledger.create("asset.glb", {}, {}, lambda _: True, Submission(metadata={"order": "4711"})).id


def told(ledger: Ledger, job_id: str) -> list[str]:
    log = read(ledger.sessions, job_id)
    assert [event.number for event in log] == list(range(1, len(log) + 1))
    return [event.type.removeprefix("watermark.") for event in log]


def test_a_job_tells_of_each_state_and_stage_it_goes_through_once(ledger: Ledger) -> None:
    job_id = create(ledger)
    job = ledger.claim(job_id, 60)
    assert job is not None
    assert ledger.claim(job_id, 60) is None
    for stage, progress in (("reading", 0.0), ("reading", 0.1), ("placing", 0.2), ("placing", 0.3), ("placing", 0.4)):
        assert ledger.heartbeat(job.lease, 60, stage, progress)
    assert ledger.succeed(job.lease)
    assert not ledger.succeed(job.lease)
    assert not ledger.heartbeat(job.lease, 60, "cutting", 0.5)
    assert not ledger.cancel(job_id)
    drop_artifacts(ledger.sessions, job_id)
    drop_artifacts(ledger.sessions, job_id)
    assert told(ledger, job_id) == ["queued", "running", "stage", "stage", "succeeded", "expired"]
    stages = [event for event in read(ledger.sessions, job_id) if event.type is EventType.STAGE]
    assert [(event.data["stage"], event.data["progress"]) for event in stages] == [("reading", 0.0), ("placing", 0.2)]


def test_an_event_shows_the_job_as_it_stood_then(ledger: Ledger) -> None:
    job_id = create(ledger)
    job = ledger.claim(job_id, 60)
    assert job is not None
    ledger.fail(job.lease, BROKEN)
    first, _, last = read(ledger.sessions, job_id)
    assert (first.data["state"], first.data["attempts"], first.data["error"]) == ("queued", 0, None)
    assert last.data == {
        "id": job_id,
        "state": "failed",
        "stage": None,
        "progress": 0.0,
        "created_at": events.rfc3339(job.created_at),
        "started_at": job.started_at and events.rfc3339(job.started_at),
        "finished_at": last.data["finished_at"],
        "expires_at": None,
        "attempts": 1,
        "cached": False,
        "metadata": {"order": "4711"},
        "error": {"code": "no_faces", "detail": "It has no faces.", "remedy": "Add some."},
    }
    assert first.data["finished_at"] is None
    assert last.data["finished_at"].endswith("Z")


def test_a_job_that_goes_back_to_the_queue_tells_of_it(ledger: Ledger) -> None:
    job_id = create(ledger)
    job = ledger.claim(job_id, 60)
    assert job is not None
    ledger.release(job.lease)
    ledger.claim(job_id, 0.001)
    time.sleep(0.01)
    ledger.recover(2, WORKER_LOST)
    ledger.claim(job_id, 0.001)
    time.sleep(0.01)
    ledger.recover(2, WORKER_LOST)
    assert told(ledger, job_id) == ["queued", "running", "queued", "running", "queued", "running", "failed"]


def test_what_is_undone_is_not_told(ledger: Ledger, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []

    def refuse(session: Session, job_id: str) -> None:
        seen.append(job_id)
        session.flush()
        raise BROKEN

    with pytest.raises(MeshmarkError):
        ledger.create("asset.glb", {}, {}, lambda _: True, Submission(condition=refuse))
    assert read(ledger.sessions, seen[0]) == []

    job_id = create(ledger)

    def stumble(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("service.jobs.transitions.record", stumble)
        with pytest.raises(KeyboardInterrupt):
            ledger.cancel(job_id)
    job = ledger.get(job_id)
    assert job is not None
    assert job.state == JobState.QUEUED, "what cannot be told does not happen"
    assert told(ledger, job_id) == ["queued"]


def test_of_many_who_end_a_job_at_once_one_tells_of_it(ledger: Ledger) -> None:
    job_id = create(ledger)
    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(lambda _: ledger.cancel(job_id), range(8))) == 1
    assert told(ledger, job_id) == ["queued", "canceled"]


def test_reading_goes_on_after_the_last_event_that_was_read(ledger: Ledger) -> None:
    job_id = create(ledger)
    ledger.cancel(job_id)
    create(ledger)
    assert [event.number for event in read(ledger.sessions, job_id, after=1)] == [2]
    assert read(ledger.sessions, job_id, after=2) == []


def test_old_events_of_jobs_that_ended_are_forgotten_and_numbers_go_on(ledger: Ledger) -> None:
    ended, waiting = create(ledger), create(ledger)
    job = ledger.claim(ended, 60)
    assert job is not None
    ledger.succeed(job.lease)
    forget(ledger.sessions, now() - timedelta(minutes=1))
    assert len(read(ledger.sessions, ended)) == 3
    forget(ledger.sessions, now() + timedelta(seconds=1))
    assert read(ledger.sessions, ended) == []
    assert len(read(ledger.sessions, waiting)) == 1
    drop_artifacts(ledger.sessions, ended)
    assert [(event.number, event.type) for event in read(ledger.sessions, ended)] == [(4, EventType.EXPIRED)]
