"""Copies in the ledger, on every database."""

from collections.abc import Iterator
from contextlib import closing

import pytest
from sqlalchemy.orm import Session

from core.errors import ErrorCode, MeshmarkError
from service.jobs import copies, turns
from service.jobs.copies import NewCopy
from service.jobs.ledger import Content, Ledger, Submission
from service.jobs.models import ArtifactKind, Job, JobState, Queue
from service.jobs.references import MissingContentError

INPUT, PLAN = Content("ab" * 32, 3), Content("cd" * 32, 5)
WANTED = [NewCopy(f"ORDER-{number}", {"number": str(number)}) for number in range(1000)]


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    with closing(Ledger(database_url)) as ledger:
        yield ledger


def create(ledger: Ledger, number: int = 1000) -> Job:
    """A job with a thousand copies, or so many."""

    def condition(session: Session, job_id: str) -> None:
        job = session.get_one(Job, job_id)
        ledger.add_copies(session, job, WANTED[:number], job.created_at, None)

    files = {ArtifactKind.INPUT: INPUT}
    return ledger.create("a.glb", {"text": "HI"}, files, lambda _: True, Submission("acme", condition=condition))


def test_a_thousand_copies_are_let_go_in_their_order_by_the_success_of_their_job(ledger: Ledger) -> None:
    job = create(ledger)
    assert turns.next_job(ledger.sessions, Queue.SMALL) == job.id
    running = ledger.claim(job.id, 60)
    assert running
    assert turns.next_job(ledger.sessions, Queue.SMALL) is None, "they wait for it"
    assert ledger.publish(running.lease, ArtifactKind.PLAN, PLAN, lambda _: True)
    assert ledger.succeed(running.lease)
    made = copies.list_copies(ledger.sessions, job).jobs
    assert [copy.parameters["text"] for copy in made] == [copy.text for copy in WANTED]
    assert {(file.kind, file.sha256) for copy in made for file in copy.artifacts} == {
        (ArtifactKind.INPUT, INPUT.sha256),
        (ArtifactKind.PLACEMENT, PLAN.sha256),
    }
    assert turns.next_job(ledger.sessions, Queue.SMALL) == made[0].id
    own = ledger.create("b.glb", {"text": "HI"}, {ArtifactKind.INPUT: INPUT}, lambda _: True, Submission("acme"))
    assert turns.next_job(ledger.sessions, Queue.SMALL) == own.id, "copies hold up none of the tenant's other jobs"


def test_copies_fail_with_their_job(ledger: Ledger) -> None:
    running = ledger.claim(create(ledger, 20).id, 60)
    assert running
    ledger.fail(running.lease, MeshmarkError(ErrorCode.NO_FACES, "It has no faces.", "Add some."))
    made = copies.list_copies(ledger.sessions, running).jobs
    assert {(copy.state, copy.error_code, copy.event_count) for copy in made} == {(JobState.FAILED, "no_faces", 2)}


def test_where_files_are_gone_nothing_is_recorded(ledger: Ledger) -> None:
    job = ledger.create("a.glb", {"text": "HI"}, {ArtifactKind.INPUT: INPUT}, lambda _: True)
    with pytest.raises(MissingContentError):
        ledger.copy(job, WANTED[:1], lambda _: False, None, lambda _session, _job_id: None)
    assert copies.list_copies(ledger.sessions, job).jobs == []
