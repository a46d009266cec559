"""Forgetting: of a job's files and its client's data when it is deleted, and of jobs that are old."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import Session

from core.errors import ErrorCode, MeshmarkError
from service.config import Settings
from service.jobs import dropped, idempotency, sources
from service.jobs.clock import now
from service.jobs.events import ENDINGS
from service.jobs.forgetting import BATCH, drop_artifacts, forget
from service.jobs.ledger import Content, Ledger, Submission
from service.jobs.models import (
    Artifact,
    ArtifactKind,
    Base,
    DroppedObject,
    EventType,
    IdempotencyKey,
    Job,
    JobEvent,
    JobSource,
    JobState,
    Tenant,
    WebhookDelivery,
)
from service.jobs.queue import create_queue
from service.jobs.references import unreferenced
from service.webhooks.deliver import Outcome, Result
from service.webhooks.deliveries import claim, settle
from service.webhooks.endpoints import create_endpoint
from tests.service.conftest import Client, client_with
from tests.worker.engines import asset
from worker import sweeper
from worker.tasks import Worker

YEAR = timedelta(days=365)
REFUSED = MeshmarkError(ErrorCode.NO_PLACEMENT, "The material 'secret-7' is too small.", "Enlarge 'secret-7'.")
GOOD = Outcome(Result.DELIVERED, 200, None, "", 0.1, None)


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    with closing(Ledger(database_url, retention=0.001)) as ledger:
        yield ledger


def job_in(ledger: Ledger, state: JobState, name: str, tenant: str = "default") -> str:
    """The id of a job in a state, with all that can refer to one."""
    reserved = idempotency.reserve(ledger.sessions, tenant, name, "print")
    assert isinstance(reserved, idempotency.Reservation)

    def beside(session: Session, job_id: str) -> None:
        idempotency.settle(session, reserved, job_id)
        sources.record(session, job_id, "https://shop.example/secret-7.glb")
        dropped.record(session, job_id, name, "source", "incoming/secret-7.glb")

    said = Submission(tenant, {"order": "secret-7"}, "https://shop.example/secret-7", condition=beside)
    contents = {ArtifactKind.INPUT: Content(name * 16, 10), ArtifactKind.FONT: Content("f0f0" * 16, 5)}
    job = ledger.create("secret-7.glb", {"text": "secret-7"}, contents, lambda _: True, said, "key")
    if state == JobState.CANCELED:
        ledger.cancel(job.id, tenant)
    elif state != JobState.QUEUED:
        claimed = ledger.claim(job.id, 60)
        assert claimed
        assert ledger.publish(claimed.lease, ArtifactKind.MODEL, Content(name * 16, 7), lambda _: True)
        if state == JobState.FAILED:
            ledger.fail(claimed.lease, REFUSED)
        elif state != JobState.RUNNING:
            ledger.succeed(claimed.lease)
        if state == JobState.EXPIRED:
            drop_artifacts(ledger.sessions, job.id)
    return job.id


def age(ledger: Ledger, *job_ids: str) -> None:
    with ledger.sessions.begin() as session:
        session.execute(update(Job).where(Job.id.in_(job_ids)).values(finished_at=now() - YEAR))


def deliver_all(ledger: Ledger) -> None:
    with ledger.sessions() as session:
        due = session.scalars(select(WebhookDelivery.id)).all()
    for delivery_id in due:
        if claimed := claim(ledger.sessions, delivery_id):
            assert settle(ledger.sessions, claimed, GOOD)


def stored(ledger: Ledger, tenant: str = "default") -> int:
    """The bytes that are counted for a tenant, which are always the sum of what there is."""
    with ledger.sessions() as session:
        counted = session.scalar(select(Tenant.stored_bytes).where(Tenant.id == tenant)) or 0
        of_tenant = select(func.sum(Artifact.size)).join(Job, Job.id == Artifact.job_id).where(Job.tenant_id == tenant)
        assert counted == int(session.scalar(of_tenant) or 0)
    return counted


def mentions(ledger: Ledger, text: str) -> list[str]:
    """The tables that have a text in a row."""
    with ledger.sessions() as session:
        tables = Base.metadata.sorted_tables
        return [table.name for table in tables if text in str(session.execute(select(table)).all())]


def test_old_jobs_without_results_are_forgotten_with_all_that_refers_to_them(ledger: Ledger) -> None:
    create_endpoint(ledger.sessions, "default", "https://shop.example/", ENDINGS, None)
    states = [*JobState]
    old = {state: job_in(ledger, state, f"aaa{number}") for number, state in enumerate(states)}
    young = job_in(ledger, JobState.FAILED, "bbbb")
    other = job_in(ledger, JobState.FAILED, "cccc", "acme")
    deliver_all(ledger)
    age(ledger, *old.values(), other)
    number, hashes = forget(ledger.sessions, timedelta(days=364))
    gone = {old[state] for state in (JobState.FAILED, JobState.CANCELED, JobState.EXPIRED)} | {other}
    assert number == len(gone)
    names = {f"aaa{states.index(state)}" * 16 for state in (JobState.FAILED, JobState.CANCELED)}
    assert hashes == names | {"cccc" * 16, "f0f0" * 16}
    for job_id in gone:
        assert mentions(ledger, job_id) == []
    for job_id in {*old.values(), young} - gone:
        assert {"jobs", "job_metadata", "job_events", "dropped_objects", "idempotency_keys"} <= {
            *mentions(ledger, job_id)
        }
    assert (stored(ledger, "acme"), forget(ledger.sessions, timedelta(days=364))) == (0, (0, set()))
    assert stored(ledger) == 15 + 22 + 22 + 22  # queued, running, succeeded, and the young failed one
    assert unreferenced(ledger.sessions, {"f0f0" * 16}) == set()


def test_a_long_past_is_forgotten_in_small_transactions_by_workers_beside_each_other(
    database_url: str, tmp_path: Path
) -> None:
    settings = Settings(data_dir=tmp_path, database_url=database_url)
    worker = Worker(settings, create_queue(settings), "tests.worker.engines:directed")
    with worker.ledger.sessions.begin() as session:
        moment = now() - YEAR
        past = {"state": JobState.CANCELED, "filename": "a", "parameters": {}, "finished_at": moment}
        past |= {"created_at": moment, "enqueued_at": moment}
        session.add_all(Job(id=str(number), **past) for number in range(3 * BATCH + 7))
    first, _ = forget(worker.ledger.sessions, timedelta(days=90))
    worker.settings.history_days = 0
    sweeper.forget_old_jobs(worker)
    with worker.ledger.sessions() as session:
        assert (first, session.scalar(select(func.count()).select_from(Job))) == (BATCH, 2 * BATCH + 7)
    worker.settings.history_days = 90
    sweeper.forget_old_jobs(worker)
    with worker.ledger.sessions() as session:
        assert session.scalar(select(func.count()).select_from(Job)) == 0
    worker.close()


@pytest.mark.parametrize("state", [JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELED])
def test_what_was_said_about_a_job_goes_when_it_is_deleted_and_what_is_to_be_told_once_it_is_told(
    ledger: Ledger, state: JobState
) -> None:
    create_endpoint(ledger.sessions, "default", None, ENDINGS, None)
    job_id = job_in(ledger, state, "dddd")
    with ledger.sessions.begin() as session:  # those have lives of their own
        for table in (IdempotencyKey, DroppedObject, JobSource):
            session.execute(delete(table))
    drop_artifacts(ledger.sessions, job_id, erase=True)
    # What is pending is told as it is: the address, and the events that webhooks tell of.
    assert mentions(ledger, "secret-7") == ["job_events", "webhook_deliveries"]
    with ledger.sessions() as session:
        events = session.scalars(select(JobEvent).order_by(JobEvent.number)).all()
    kept = {event.type for event in events if "secret-7" in str(event.data)}
    assert kept <= {*ENDINGS}
    assert kept
    deliver_all(ledger)
    assert mentions(ledger, "secret-7") == ["webhook_deliveries"], "the log of webhooks has the address for 30 days"
    job = ledger.get(job_id)
    assert job is not None
    assert (job.erased, job.filename, job.parameters, job.webhook, job.artifacts) == (True, "erased", {}, None, [])
    assert job.error_code == ("no_placement" if state == JobState.FAILED else None)
    assert events[0].type == EventType.QUEUED
    assert stored(ledger) == 0


def test_a_succeeded_job_without_its_files_is_expired(ledger: Ledger) -> None:
    job = ledger.get(job_in(ledger, JobState.EXPIRED, "eeee"))
    assert job is not None
    assert (job.state, job.artifacts) == (JobState.EXPIRED, [])


@pytest.mark.parametrize("state", [JobState.QUEUED, JobState.RUNNING])
def test_the_files_of_a_job_that_has_not_ended_stay(ledger: Ledger, state: JobState) -> None:
    job_id = job_in(ledger, state, "eeee")
    assert drop_artifacts(ledger.sessions, job_id) == set()
    job = ledger.get(job_id)
    assert job is not None
    assert job.artifact(ArtifactKind.INPUT) is not None


def test_a_deleted_job_keeps_nothing_that_its_worker_publishes_meanwhile(ledger: Ledger) -> None:
    for number in range(20):
        job_id = job_in(ledger, JobState.RUNNING, f"{number:04}")
        (lease,) = ledger.running()

        def delete(job_id: str = job_id) -> None:
            ledger.cancel(job_id)
            drop_artifacts(ledger.sessions, job_id)

        with ThreadPoolExecutor(2) as pool:
            pool.submit(ledger.publish, lease, ArtifactKind.MODEL, Content("ab" * 32, 3), lambda _: True)
            pool.submit(delete).result()
        job = ledger.get(job_id)
        assert job is not None
        assert job.artifacts == []


def test_a_client_who_deletes_a_job_finds_that_there_was_one_and_no_more(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path)) as client:
        url = submit(client, '{"order": "secret-7"}')
        client.run(url)
        assert client.http.delete(url).status_code == 204
        job = client.http.get(url).json()
        assert (job["state"], job["parameters"], job["metadata"], job["input"]) == ("expired", None, {}, None)
        assert "secret-7" not in client.http.get("/v1/watermarks").text + client.http.get(f"{url}/events").text
        assert client.http.get("/v1/watermarks", params={"metadata": "order:secret-7"}).json()["items"] == []
        assert client.http.delete(url).status_code == 204


def submit(client: Client, metadata: str) -> str:
    parts = {"file": ("asset.obj", asset())}
    answer = client.http.post(
        "/v1/watermarks", files=parts, data={"params": '{"text": "secret-7"}', "metadata": metadata}
    )
    assert answer.status_code == 202, answer.text
    return str(answer.headers["Location"])
