"""Changes of a job's row, each a single compare-and-set UPDATE in a transaction of its caller.

The event of a change of state, and the ends of the copies that wait for the job, belong to the same transaction.
"""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, delete, select, update
from sqlalchemy.orm import Session

from service.jobs import copies
from service.jobs.events import record
from service.jobs.models import COMPARED, Artifact, Job, JobState, Lease
from service.jobs.quota import add_stored

ACTIVE = (JobState.QUEUED, JobState.RUNNING)


def under(lease: Lease) -> tuple[ColumnElement[bool], ...]:
    """Condition that a job runs under a lease, which is void otherwise."""
    return (Job.id == lease.job_id, Job.state == JobState.RUNNING, Job.lease_token == lease.token)


def change(session: Session, condition: Iterable[ColumnElement[bool]], **values: Any) -> bool:
    """Change the one job that meets a condition, and so lock it; False where none does."""
    result: Any = session.execute(
        update(Job).where(*condition).values(**values).execution_options(synchronize_session=False)
    )
    return bool(result.rowcount == 1)


def lock(session: Session, condition: Iterable[ColumnElement[bool]]) -> bool:
    """Lock a job until the commit; False where the condition does not hold."""
    return change(session, condition, lease_token=Job.lease_token)


def move(
    session: Session,
    job_id: str,
    condition: Iterable[ColumnElement[bool]],
    state: JobState,
    moment: datetime,
    **values: Any,
) -> bool:
    """Bring a job into a state and record the event; False where the condition does not hold.

    Inputs that are kept only while the job runs are forgotten with its end. Copies that wait for the job are let go
    by its success, and have its end where it has another.
    """
    moved = change(session, (Job.id == job_id, *condition), state=state, **values)
    if moved:
        job = record(session, job_id, state, moment)
        if state not in ACTIVE and not job.keeps_input:
            drop_files(session, job_id, Artifact.kind.in_(COMPARED))
        if state not in ACTIVE and not job.copy_of and (waiting := copies.held(session, job_id)):
            if state is JobState.SUCCEEDED:
                let_go(session, job, waiting, moment, values)
            else:
                ended_too = {**values, "held": False}
                for copy in waiting:
                    move(session, copy, (Job.state == JobState.QUEUED,), state, moment, **ended_too)
    return moved


def let_go(session: Session, parent: Job, waiting: Sequence[str], moment: datetime, done: Mapping[str, Any]) -> None:
    """Let copies go; those that have their results already succeed with the values ``done``."""
    for copy in copies.let_go(session, parent, waiting):
        move(session, copy, (Job.state == JobState.QUEUED,), JobState.SUCCEEDED, moment, cached=True, **done)


def drop_files(session: Session, job_id: str, *which: ColumnElement[bool]) -> set[str]:
    """Forget files of a job that is locked: those that meet the conditions, all without any; returns their hashes."""
    dropped = delete(Artifact).where(Artifact.job_id == job_id, *which).returning(Artifact.sha256, Artifact.size)
    rows = session.execute(dropped.execution_options(synchronize_session=False)).all()
    if rows:
        add_stored(session, tenant_of(session, job_id), -sum(row.size for row in rows))
    return {row.sha256 for row in rows}


def tenant_of(session: Session, job_id: str) -> str:
    """Tenant of a job that there is."""
    return session.scalars(select(Job.tenant_id).where(Job.id == job_id)).one()
