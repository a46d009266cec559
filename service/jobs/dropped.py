"""Objects dropped in a watched bucket, their jobs, and whether the results were written back.

An object's id is a hash of its place and its version, so however many notifications it has, it makes one job. Its row
is recorded with the job; `output` then goes from pending to one of the other states, once, and pending rows are retried
until it does. Writing is idempotent. When a dead job is retried as another one, its object belongs to that one from
then on.
"""

import hashlib
import json
from datetime import timedelta
from enum import StrEnum

from sqlalchemy import ColumnElement, exists, select, update
from sqlalchemy.orm import Session, aliased, sessionmaker

from service.jobs.clock import clock
from service.jobs.models import DroppedObject, Job
from service.jobs.transitions import ACTIVE

TAKEN = timedelta(minutes=5)  # lease of a worker on an object: then another one may take it
LONGEST_PAUSE = 300.0  # seconds of backoff at most

Sessions = sessionmaker[Session]


class Output(StrEnum):
    """State of writing a job's results back."""

    PENDING = "pending"
    WRITTEN = "written"
    NONE = "none"  # the job made none, or they are deleted
    SUPERSEDED = "superseded"  # a later version of the object came since


def identity(source: str, bucket: str, key: str, version: str) -> str:
    """Id of one version of an object."""
    return hashlib.sha256(json.dumps([source, bucket, key, version]).encode()).hexdigest()


def record(session: Session, job_id: str, object_id: str, source: str, key: str) -> None:
    """Record the object of a job, in the transaction that records the job.

    Raises:
        sqlalchemy.exc.IntegrityError: the object has a job already.
    """
    moment = clock(session)
    session.add(
        DroppedObject(
            id=object_id, job_id=job_id, source=source, key=key, output=Output.PENDING, due_at=moment, created_at=moment
        )
    )
    session.flush()


def hand_over(session: Session, job_id: str, successor: str) -> None:
    """Assign the object of a job to its successor, whose results are then the ones to be written."""
    values = {"job_id": successor, "output": Output.PENDING, "tries": 0, "due_at": clock(session)}
    session.execute(update(DroppedObject).where(DroppedObject.job_id == job_id).values(**values))


def job_of(sessions: Sessions, object_id: str) -> str | None:
    """Job of an object, if it has one."""
    with sessions() as session:
        return session.scalar(select(DroppedObject.job_id).where(DroppedObject.id == object_id))


def object_of(sessions: Sessions, job_id: str) -> DroppedObject | None:
    """Object that a job was made of, if it was."""
    with sessions() as session:
        return session.scalar(select(DroppedObject).where(DroppedObject.job_id == job_id))


def take_due(sessions: Sessions, source: str) -> DroppedObject | None:
    """Take an object of a hook whose job has ended and whose results are to be written; for TAKEN, no other worker gets
    it."""
    with sessions() as session:
        moment = clock(session)
        pending = (
            DroppedObject.output == Output.PENDING,
            DroppedObject.due_at <= moment,
            DroppedObject.source == source,
        )
        due = (
            select(DroppedObject)
            .join(Job, Job.id == DroppedObject.job_id)
            .where(*pending, Job.state.not_in(ACTIVE))
            .order_by(DroppedObject.due_at)
            .limit(20)  # candidates, some of which other workers may take at this moment
        )
        found = list(session.scalars(due))
    for item in found:
        if _change(sessions, item, due_at=moment + TAKEN, tries=item.tries + 1):
            item.tries += 1
            return item
    return None


def settle(sessions: Sessions, item: DroppedObject, output: Output) -> None:
    """Record the outcome of an object that was taken, unless it was handed over or taken again since.

    Where they were written, those of a later version that came meanwhile are written again: they may be under them.
    """
    later = (
        DroppedObject.source == item.source,
        DroppedObject.key == item.key,
        DroppedObject.created_at > item.created_at,
        DroppedObject.output.in_((Output.PENDING, Output.WRITTEN)),
    )
    with sessions.begin() as session:
        session.execute(update(DroppedObject).where(*_taken(item)).values(output=output))
        if output is Output.WRITTEN:
            again = {"output": Output.PENDING, "due_at": clock(session), "tries": DroppedObject.tries + 1}
            session.execute(update(DroppedObject).where(*later).values(**again))  # voids a settlement under way


def postpone(sessions: Sessions, item: DroppedObject) -> None:
    """Release an object that was taken for another attempt, with exponential backoff."""
    pause = min(2.0 ** min(item.tries, 16), LONGEST_PAUSE)
    with sessions.begin() as session:
        later = update(DroppedObject).where(*_taken(item))
        session.execute(later.values(due_at=clock(session) + timedelta(seconds=pause)))


def is_superseded(sessions: Sessions, item: DroppedObject) -> bool:
    """Test whether a later version of the object came."""
    later = aliased(DroppedObject)
    there = exists().where(later.source == item.source, later.key == item.key, later.created_at > item.created_at)
    with sessions() as session:
        return bool(session.scalar(select(there)))


def _change(sessions: Sessions, item: DroppedObject, **values: object) -> bool:
    """Change a row unless another process has changed it since it was read (compare-and-set)."""
    with sessions.begin() as session:
        changed = update(DroppedObject).where(*_taken(item)).values(**values).returning(DroppedObject.id)
        return session.scalar(changed.execution_options(synchronize_session=False)) is not None


def _taken(item: DroppedObject) -> tuple[ColumnElement[bool], ...]:
    """Condition that an object is unchanged since it was read or taken."""
    return (
        DroppedObject.id == item.id,
        DroppedObject.job_id == item.job_id,
        DroppedObject.tries == item.tries,
        DroppedObject.output == Output.PENDING,
    )
