"""Copies of a watermark job: jobs of their own with other texts at the places of its marks.

They are recorded with the job, in its transaction, and held back until it has succeeded: no queue shows a held job. The
transaction of that success gives them its inputs and its plan, and lets them go; that of any other end ends them too.
So no crash can lose a copy, or leave one that nothing will start. Once let go, they need nothing of the job any more:
their rows refer to the content themselves.
"""

import uuid
from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

from sqlalchemy import func, insert, literal, or_, select, tuple_, update
from sqlalchemy.orm import Session, sessionmaker

from service.correlation import correlation
from service.jobs.clock import clock
from service.jobs.events import snapshot
from service.jobs.listing import Page, cursor_of, position_of
from service.jobs.models import (
    Artifact,
    ArtifactKind,
    EventType,
    Job,
    JobEvent,
    JobState,
    MetadataEntry,
    Priority,
    UtcDateTime,
)
from service.jobs.quota import add_stored

MOST = 1000  # copies of one request
# Files of a job that its copies have too, under the names that they have there.
SHARED = {
    ArtifactKind.INPUT: ArtifactKind.INPUT,
    ArtifactKind.FONT: ArtifactKind.FONT,
    ArtifactKind.LOGO: ArtifactKind.LOGO,
    ArtifactKind.PLAN: ArtifactKind.PLACEMENT,
}
# Parameters of a job's copies: their places are the job's, which was measured, explained and drawn.
UNREPEATED = {"evaluate": "none", "explain": False, "turntable": False}
TICK = timedelta(microseconds=1)  # between two copies of a request, so that they are listed in their order


class NewCopy(NamedTuple):
    """A copy to be made: its text, the client's notes about it, and the key of equal ones' results
    (:func:`service.jobs.cache.copy_key`); None where it shall be made anew."""

    text: str
    metadata: dict[str, str]
    key: str | None = None


def add(session: Session, parent: Job, wanted: Sequence[NewCopy], moment: datetime, webhook: str | None) -> list[Job]:
    """Record copies of a job in a transaction, held back. The content of its files is locked, and the job itself where
    it has not ended."""
    parameters = {**parent.parameters, **UNREPEATED}
    jobs = [
        Job(
            id=str(uuid.uuid4()),
            tenant_id=parent.tenant_id,
            copy_of=parent.id,
            held=True,
            queue=parent.queue,
            priority=Priority.LOW,
            correlation=correlation(),
            state=JobState.QUEUED,
            filename=parent.filename,
            parameters={**parameters, "text": copy.text},
            result_key=copy.key,
            webhook=webhook,
            created_at=moment + number * TICK,
            enqueued_at=moment,
            event_count=1,
            progress=0.0,
            attempts=0,
            cached=False,
            artifacts=[],
            metadata_entries=[MetadataEntry(key=key, value=value) for key, value in copy.metadata.items()],
        )
        for number, copy in enumerate(wanted)
    ]
    session.add_all(jobs)
    session.flush()
    queued = EventType.of(jobs[0].kind, JobState.QUEUED)
    events = [
        {"job_id": job.id, "number": 1, "type": queued, "data": snapshot(job), "created_at": job.created_at}
        for job in jobs
    ]
    session.execute(insert(JobEvent), events)
    return jobs


def held(session: Session, job_id: str) -> list[str]:
    """The copies that wait for a job, in their order."""
    waiting = (
        select(Job.id)
        .where(Job.copy_of == job_id, Job.held, Job.state == JobState.QUEUED)
        .order_by(Job.created_at, Job.id)
    )
    return list(session.scalars(waiting))


def let_go(session: Session, parent: Job, copies: Sequence[str]) -> list[str]:
    """Give copies the files that they share with a job that has succeeded, and let them be started.

    Returns:
        Those that have their results already, of equal ones: they need no start.
    """
    files = [item for item in parent.artifacts if item.kind in SHARED]
    rows = [
        {"job_id": job_id, "kind": SHARED[file.kind], "sha256": file.sha256, "size": file.size}
        for job_id in copies
        for file in files
    ]
    session.execute(insert(Artifact), rows)
    freed = update(Job).where(Job.copy_of == parent.id, Job.held).values(held=False)
    session.execute(freed.execution_options(synchronize_session=False))
    add_stored(session, parent.tenant_id, len(copies) * sum(file.size for file in files))
    return _served(session, parent, copies, {(row["kind"], row["sha256"]) for row in rows})


def _served(session: Session, parent: Job, copies: Sequence[str], inputs: set[tuple[object, object]]) -> list[str]:
    """Give copies the results of the latest equal ones of the tenant, and return these copies.

    The rows of the latter are locked: their files are forgotten after this transaction, or they are not found.
    """
    keyed = select(Job.id, Job.result_key).where(Job.id.in_(copies), Job.result_key.is_not(None))
    keys = {row.id: row.result_key for row in session.execute(keyed)}
    places = [(kind, sha256) for kind, sha256 in inputs if kind == ArtifactKind.PLACEMENT]
    equal = (
        Job.tenant_id == parent.tenant_id,
        Job.result_key.in_(set(keys.values())),
        Job.state == JobState.SUCCEEDED,
        Job.copy_of.is_not(None),
        Job.artifacts.any(tuple_(Artifact.kind, Artifact.sha256).in_(places)),
        or_(Job.expires_at.is_(None), Job.expires_at > clock(session)),
    )
    # Of a copy that was asked for over and over, only the last time is looked at.
    latest = select(func.max(Job.created_at)).where(*equal).group_by(Job.result_key)
    latest_jobs = select(Job).where(*equal, Job.created_at.in_(latest)).order_by(Job.created_at, Job.id)
    results: dict[str | None, list[Artifact]] = {}
    for job in session.scalars(latest_jobs.with_for_update(read=True)):
        if {(file.kind, file.sha256) for file in job.artifacts if file.kind in SHARED.values()} == inputs:
            results[job.result_key] = [file for file in job.artifacts if file.kind not in SHARED.values()]
    found = {copy: files for copy in copies if (files := results.get(keys.get(copy)))}
    rows = [
        {"job_id": copy, "kind": file.kind, "sha256": file.sha256, "size": file.size}
        for copy, files in found.items()
        for file in files
    ]
    if rows:
        session.execute(insert(Artifact), rows)
        add_stored(session, parent.tenant_id, sum(file.size for files in found.values() for file in files))
    return [*found]


def queued(sessions: sessionmaker[Session], job_id: str) -> list[str]:
    """The copies of a job that wait to be started."""
    waiting = (Job.copy_of == job_id, Job.state == JobState.QUEUED, ~Job.held)
    with sessions() as session:
        return list(session.scalars(select(Job.id).where(*waiting).order_by(Job.created_at, Job.id)))


def list_copies(sessions: sessionmaker[Session], job: Job, limit: int | None = None, cursor: str | None = None) -> Page:
    """The copies of a job in the order in which they were asked for: all, or so many after a cursor.

    Raises:
        MeshmarkError: ``invalid_request``, the cursor is not one.
    """
    found = select(Job).where(Job.copy_of == job.id, Job.tenant_id == job.tenant_id)
    found = found.order_by(Job.created_at, Job.id)
    if cursor:
        last = position_of(cursor)
        found = found.where(
            tuple_(Job.created_at, Job.id) > tuple_(literal(last.created_at, UtcDateTime), literal(last.id))
        )
    with sessions() as session:
        jobs = list(session.scalars(found if limit is None else found.limit(limit + 1)))
    more = limit is not None and len(jobs) > limit
    return Page(jobs[:limit], cursor_of(jobs[limit - 1]) if limit is not None and more else None)


def asked_together(sessions: sessionmaker[Session], first: Job, number: int) -> list[Job]:
    """The copies that one request asked for, of which one is the ``first``."""
    together = (Job.copy_of == first.copy_of, Job.created_at >= first.created_at)
    last = first.created_at + (number - 1) * TICK
    with sessions() as session:
        found = select(Job).where(*together, Job.created_at <= last).order_by(Job.created_at, Job.id)
        return list(session.scalars(found))
