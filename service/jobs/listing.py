"""Pages of a tenant's jobs, newest first."""

import re
from base64 import urlsafe_b64decode, urlsafe_b64encode
from datetime import UTC, datetime
from typing import NamedTuple

from sqlalchemy import literal, select, tuple_
from sqlalchemy.orm import Session, sessionmaker

from core.errors import ErrorCode, MeshmarkError
from service.jobs.models import Job, JobKind, JobState, MetadataEntry, UtcDateTime

POSITION = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}) ([\x21-\x7e]{1,36})")


class Position(NamedTuple):
    """Position of a job in the list."""

    created_at: datetime
    id: str


class Filters(NamedTuple):
    """Filters of a list of jobs of one kind; None: no filter."""

    state: JobState | None = None
    created_after: datetime | None = None
    created_before: datetime | None = None
    metadata: tuple[str, str] | None = None
    kind: JobKind = JobKind.WATERMARK


class Page(NamedTuple):
    """Some jobs, and the cursor of those that follow; None: there are no more."""

    jobs: list[Job]
    cursor: str | None


def list_jobs(
    sessions: sessionmaker[Session], tenant: str, filters: Filters, limit: int, cursor: str | None = None
) -> Page:
    """The tenant's newest jobs, or those after a cursor.

    A page begins where the one before ended, not at a number, so that jobs that come meanwhile shift nothing.

    Raises:
        MeshmarkError: ``invalid_request``, the cursor is not one.
    """
    mine = (Job.tenant_id == tenant, Job.kind == filters.kind)
    jobs = select(Job).where(*mine).order_by(Job.created_at.desc(), Job.id.desc()).limit(limit + 1)
    if filters.state:
        jobs = jobs.where(Job.state == filters.state)
    if filters.created_after:
        jobs = jobs.where(Job.created_at > filters.created_after)
    if filters.created_before:
        jobs = jobs.where(Job.created_at < filters.created_before)
    if filters.metadata:
        key, value = filters.metadata
        jobs = jobs.where(Job.metadata_entries.any((MetadataEntry.key == key) & (MetadataEntry.value == value)))
    if cursor:
        last = position_of(cursor)
        jobs = jobs.where(
            tuple_(Job.created_at, Job.id) < tuple_(literal(last.created_at, UtcDateTime), literal(last.id))
        )
    with sessions() as session:
        found = list(session.scalars(jobs))
    return Page(found[:limit], cursor_of(found[limit - 1]) if len(found) > limit else None)


def cursor_of(job: Job) -> str:
    """Cursor of the jobs that follow one."""
    moment = job.created_at.astimezone(UTC).replace(tzinfo=None).isoformat(timespec="microseconds")
    return urlsafe_b64encode(f"{moment} {job.id}".encode()).decode().rstrip("=")


def position_of(cursor: str) -> Position:
    """Position that a cursor stands for.

    Raises:
        MeshmarkError: ``invalid_request``, it is not one.
    """
    try:
        text = urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)).decode("ascii")
        match = POSITION.fullmatch(text)
        if match is None:
            raise ValueError(text)
        return Position(datetime.fromisoformat(match[1]).replace(tzinfo=UTC), match[2])
    except ValueError:  # binascii's and Unicode's errors are such, too
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "The cursor is not one that a list of jobs gave.",
            "Follow the link `next` of a list as it is, or leave out the cursor to begin anew.",
        ) from None
