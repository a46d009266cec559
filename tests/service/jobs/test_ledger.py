import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from typing import Any

import pytest
from sqlalchemy import update
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from core.errors import ErrorCode, MeshmarkError
from service.jobs.clock import now
from service.jobs.dead import WORKER_LOST
from service.jobs.forgetting import drop_artifacts, overdue
from service.jobs.ledger import Content, Ledger, Submission
from service.jobs.models import ArtifactKind, Job, JobState, Lease
from service.jobs.references import MissingContentError, unreferenced
from tests.service.postgres import postgres_server

CONTENT = Content("ab" * 32, 3)
BROKEN = MeshmarkError(ErrorCode.NO_FACES, "It has no faces.", "Add some.")


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


def stored(_sha256: str) -> bool:
    """A store that has everything."""
    return True


def create(ledger: Ledger) -> Job:
    return ledger.create("asset.glb", {"text": "HI"}, {ArtifactKind.INPUT: CONTENT}, stored)


def claim(ledger: Ledger, job_id: str, lease_seconds: float = 60) -> Job:
    job = ledger.claim(job_id, lease_seconds)
    assert job is not None
    return job


def read(ledger: Ledger, job_id: str) -> Job:
    job = ledger.get(job_id)
    assert job is not None
    return job


def silent(ledger: Ledger) -> Job:
    """A running job whose lease has just run out."""
    job = claim(ledger, create(ledger).id, lease_seconds=0.001)
    time.sleep(0.01)
    return job


def snapshot(job: Job) -> dict[str, Any]:
    return {column.name: getattr(job, column.name) for column in Job.__table__.columns}


def test_a_new_job_waits_and_refers_to_its_input(ledger: Ledger) -> None:
    job = read(ledger, create(ledger).id)
    assert (job.state, job.attempts, job.progress) == (JobState.QUEUED, 0, 0)
    assert job.created_at.utcoffset() is not None
    source = job.artifact(ArtifactKind.INPUT)
    assert source is not None
    assert (source.sha256, source.size) == CONTENT


def test_another_tenants_job_is_as_good_as_none(ledger: Ledger) -> None:
    job_id = ledger.create("asset.glb", {}, {}, stored, Submission("acme")).id
    assert ledger.get(job_id) is None
    assert ledger.get(job_id, "beta") is None
    assert not ledger.cancel(job_id, "beta")
    job = ledger.get(job_id, "acme")
    assert job is not None
    assert job.state == JobState.QUEUED


def test_what_a_submissions_condition_raises_undoes_the_job(ledger: Ledger) -> None:
    def refuse(_session: Session, _job_id: str) -> None:
        raise BROKEN

    with pytest.raises(MeshmarkError):
        ledger.create("asset.glb", {}, {ArtifactKind.INPUT: CONTENT}, stored, Submission(condition=refuse))
    assert ledger.waiting(-1) == []
    assert unreferenced(ledger.sessions, [CONTENT.sha256]) == {CONTENT.sha256}


def test_an_unknown_job_is_none(ledger: Ledger) -> None:
    assert ledger.get("nothing") is None
    assert ledger.claim("nothing", 60) is None


def test_of_many_workers_racing_for_jobs_each_job_goes_to_one(ledger: Ledger, database_url: str) -> None:
    jobs = [create(ledger).id for _ in range(8)]
    ledgers = [ledger, Ledger(database_url)]  # as two processes have them
    with ThreadPoolExecutor(16) as pool:
        claims = list(pool.map(lambda race: ledgers[race % 2].claim(jobs[race // 8], 60), range(64)))
    ledgers[1].close()
    assert Counter(job.id for job in claims if job) == Counter(jobs)
    assert {read(ledger, job).attempts for job in jobs} == {1}


def test_a_heartbeat_shows_the_stage_and_keeps_the_lease(ledger: Ledger) -> None:
    job = claim(ledger, create(ledger).id, lease_seconds=0.05)
    assert ledger.heartbeat(job.lease, 60, "placing", 0.25)
    time.sleep(0.06)
    assert ledger.recover(2, WORKER_LOST) == ([], [])
    now = read(ledger, job.id)
    assert (now.state, now.stage, now.progress) == (JobState.RUNNING, "placing", 0.25)


def test_a_worker_that_lost_its_lease_changes_nothing(ledger: Ledger) -> None:
    late = silent(ledger).lease
    assert ledger.recover(2, WORKER_LOST) == ([late.job_id], [])
    current = claim(ledger, late.job_id).lease
    before = snapshot(read(ledger, late.job_id))
    assert not ledger.heartbeat(late, 60, "embossing", 0.5)
    assert not ledger.publish(late, ArtifactKind.MODEL, CONTENT, stored)
    assert not ledger.succeed(late)
    assert not ledger.fail(late, BROKEN)
    assert not ledger.release(late)
    assert ledger.drop_outputs(late) == set()
    now = read(ledger, late.job_id)
    assert snapshot(now) == before
    assert now.artifact(ArtifactKind.MODEL) is None
    assert ledger.succeed(current)


END: dict[str, Callable[[Ledger, Lease], object]] = {
    "succeeded": lambda ledger, lease: ledger.succeed(lease),
    "failed": lambda ledger, lease: ledger.fail(lease, BROKEN),
    "canceled": lambda ledger, lease: ledger.cancel(lease.job_id),
}


@pytest.mark.parametrize("state", END)
def test_a_job_that_has_ended_never_changes_again(ledger: Ledger, state: str) -> None:
    lease = claim(ledger, create(ledger).id).lease
    assert END[state](ledger, lease)
    before = snapshot(read(ledger, lease.job_id))
    assert before["state"] == state
    for transition in END.values():
        assert not transition(ledger, lease)
    assert ledger.claim(lease.job_id, 60) is None
    assert not ledger.heartbeat(lease, 60, "reading", 0)
    assert not ledger.publish(lease, ArtifactKind.MODEL, CONTENT, stored)
    assert not ledger.release(lease)
    assert ledger.recover(2, WORKER_LOST) == ([], [])
    assert ledger.waiting(0) == []
    assert snapshot(read(ledger, lease.job_id)) == before


def test_a_failure_is_kept_with_its_remedy(ledger: Ledger) -> None:
    lease = claim(ledger, create(ledger).id).lease
    ledger.fail(lease, BROKEN)
    job = read(ledger, lease.job_id)
    assert (job.error_code, job.error_message, job.error_remedy) == ("no_faces", "It has no faces.", "Add some.")
    assert job.finished_at is not None


def test_a_job_whose_workers_vanish_is_tried_as_often_as_allowed_then_fails(ledger: Ledger) -> None:
    job_id = silent(ledger).id
    assert ledger.recover(2, WORKER_LOST) == ([job_id], [])
    claim(ledger, job_id, lease_seconds=0.001)
    time.sleep(0.01)
    assert ledger.recover(2, WORKER_LOST) == ([], [job_id])
    job = read(ledger, job_id)
    assert (job.state, job.error_code, job.attempts) == (JobState.FAILED, "worker_lost", 2)


def test_of_many_sweepers_one_requeues_a_job(ledger: Ledger) -> None:
    job_id = silent(ledger).id
    with ThreadPoolExecutor(8) as pool:
        sweeps = list(pool.map(lambda _: ledger.recover(2, WORKER_LOST), range(8)))
    assert [requeued for requeued, _ in sweeps if requeued] == [[job_id]]


def test_a_job_given_back_does_not_lose_an_attempt(ledger: Ledger) -> None:
    lease = claim(ledger, create(ledger).id).lease
    assert ledger.release(lease)
    again = claim(ledger, lease.job_id)
    assert again.attempts == 1
    assert again.lease_token > lease.token


def test_a_job_waiting_too_long_is_named_to_one_sweeper_at_a_time(ledger: Ledger) -> None:
    job_id = create(ledger).id
    assert ledger.waiting(60) == []
    time.sleep(0.01)
    assert ledger.waiting(0.005) == [job_id]
    assert ledger.waiting(60) == []


def test_a_second_attempts_output_takes_the_place_of_the_first(ledger: Ledger) -> None:
    lease = claim(ledger, create(ledger).id).lease
    first, second = Content("cd" * 32, 1), Content("ef" * 32, 2)
    assert ledger.publish(lease, ArtifactKind.MODEL, first, stored)
    assert ledger.publish(lease, ArtifactKind.MODEL, second, stored)
    model = read(ledger, lease.job_id).artifact(ArtifactKind.MODEL)
    assert model is not None
    assert (model.sha256, model.size) == second
    assert ledger.drop_outputs(lease) == {second.sha256}
    assert read(ledger, lease.job_id).artifact(ArtifactKind.INPUT) is not None


def test_nothing_is_recorded_for_content_that_the_store_does_not_have(ledger: Ledger) -> None:
    lease = claim(ledger, create(ledger).id).lease
    with pytest.raises(MissingContentError):
        ledger.create("asset.glb", {}, {ArtifactKind.INPUT: CONTENT}, lambda _: False)
    with pytest.raises(MissingContentError):
        ledger.publish(lease, ArtifactKind.MODEL, CONTENT, lambda _: False)
    assert ledger.running() == {lease}
    assert ledger.waiting(0) == []
    assert read(ledger, lease.job_id).artifact(ArtifactKind.MODEL) is None


def test_of_a_race_to_cancel_and_to_succeed_one_wins(ledger: Ledger) -> None:
    for _ in range(20):
        lease = claim(ledger, create(ledger).id).lease
        with ThreadPoolExecutor(2) as pool:
            succeeded = pool.submit(ledger.succeed, lease)
            canceled = pool.submit(ledger.cancel, lease.job_id)
        assert succeeded.result() != canceled.result()
        state = read(ledger, lease.job_id).state
        assert state == (JobState.SUCCEEDED if succeeded.result() else JobState.CANCELED)


def test_of_many_sweepers_each_announces_what_no_other_does(ledger: Ledger) -> None:
    jobs = {create(ledger).id for _ in range(20)}
    with ledger.sessions.begin() as session:  # as if they had been announced an hour ago
        session.execute(update(Job).values(enqueued_at=now() - timedelta(hours=1)))
    with ThreadPoolExecutor(8) as pool:
        named = [job_id for swept in pool.map(lambda _: ledger.waiting(60 * 30), range(8)) for job_id in swept]
    assert sorted(named) == sorted(jobs)


def test_the_ledger_goes_on_after_its_database_was_restarted() -> None:
    with postgres_server() as server:
        ledger = Ledger(server.new_database())
        job = claim(ledger, create(ledger).id)
        server.stop()
        with pytest.raises(OperationalError):
            ledger.ping()
        server.start()
        assert ledger.succeed(job.lease)
        ledger.close()


@pytest.mark.parametrize("end", END)
def test_a_job_expires_some_time_after_its_end_and_then_is_named_until_its_files_are_gone(
    database_url: str, end: str
) -> None:
    ledger = Ledger(database_url, retention=0.05)
    waiting, lease = create(ledger), claim(ledger, create(ledger).id).lease
    END[end](ledger, lease)
    job = read(ledger, lease.job_id)
    assert job.finished_at is not None
    assert job.expires_at == job.finished_at + timedelta(seconds=0.05)
    time.sleep(0.06)
    assert overdue(ledger.sessions) == [lease.job_id]
    assert drop_artifacts(ledger.sessions, lease.job_id) == {CONTENT.sha256}
    assert overdue(ledger.sessions) == []
    gone = read(ledger, lease.job_id)
    assert (gone.state, gone.expires_at) == ("expired" if end == "succeeded" else end, job.expires_at)
    assert read(ledger, waiting.id).expires_at is None
    ledger.close()


def test_without_a_retention_nothing_expires(ledger: Ledger) -> None:
    lease = claim(ledger, create(ledger).id).lease
    ledger.succeed(lease)
    assert read(ledger, lease.job_id).expires_at is None
    assert overdue(ledger.sessions) == []


def test_files_of_more_than_four_gigabytes_can_be_referred_to(ledger: Ledger) -> None:
    lease = claim(ledger, create(ledger).id).lease
    assert ledger.publish(lease, ArtifactKind.MODEL, Content("cd" * 32, 5 * 2**30), stored)
    model = read(ledger, lease.job_id).artifact(ArtifactKind.MODEL)
    assert model is not None
    assert model.size == 5 * 2**30
