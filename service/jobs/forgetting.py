"""Forgetting: the files of jobs that are deleted or have expired, and jobs without results that ended long ago.

Other jobs may have the same files: see :mod:`service.jobs.contents` for how those that none has are removed.
"""

from collections import Counter
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, case, delete, literal, or_, select
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.clock import clock
from service.jobs.erasure import erase_job
from service.jobs.models import PUBLIC_TENANT, Artifact, Job, JobKind, JobState, UtcDateTime
from service.jobs.quota import add_stored
from service.jobs.transitions import ACTIVE, change, drop_files, move

WITHOUT_RESULTS = (JobState.FAILED, JobState.CANCELED, JobState.EXPIRED)  # terminal states of a job that has none
BATCH = 50  # old jobs forgotten in one transaction, with some ten rows each
PASSING = or_(Job.tenant_id == PUBLIC_TENANT, Job.kind == JobKind.CONVERSION)  # jobs of which nothing stays
SHORT_RETENTION = timedelta(hours=1)  # the most that the files of conversions, and of jobs without a key, are kept


def expiry(moment: datetime, retention: float) -> datetime | None:
    """Expiry of a job with results that ends at a moment, by the usual retention in seconds; 0: never."""
    return moment + timedelta(seconds=retention) if retention else None


def expiry_of_ended(moment: datetime, retention: float) -> ColumnElement[datetime | None]:
    """Expiry of whichever job ends at a moment, as a value of its row."""
    usual, short = expiry(moment, retention), moment + SHORT_RETENTION
    return case((PASSING, literal(min(usual or short, short), UtcDateTime)), else_=literal(usual, UtcDateTime))


def overdue(sessions: sessionmaker[Session], limit: int = 100) -> list[str]:
    """Jobs that have expired and whose files are still there; those that expired first come first."""
    with sessions() as session:
        expired = select(Job.id).where(Job.purge_at < clock(session)).order_by(Job.purge_at).limit(limit)
        return list(session.scalars(expired))


def drop_artifacts(sessions: sessionmaker[Session], job_id: str, erase: bool = False) -> set[str]:
    """Forget an ended job's files (succeeded -> expired); returns their hashes: other jobs may have the same.

    With `erase`, and of conversions and jobs without a key, its client's data too: see
    :mod:`service.jobs.erasure`.
    """
    with sessions.begin() as session:
        move(session, job_id, (Job.state == JobState.SUCCEEDED,), JobState.EXPIRED, clock(session))
        if not change(session, (Job.id == job_id, Job.state.not_in(ACTIVE)), purge_at=None):
            return set()
        if erase or session.scalar(select(Job.id).where(Job.id == job_id, PASSING)):
            erase_job(session, job_id)
        return drop_files(session, job_id)


def forget(sessions: sessionmaker[Session], age: timedelta, limit: int = BATCH) -> tuple[int, set[str]]:
    """Delete up to `limit` jobs without results that ended more than `age` ago, with all that refers to them.

    Returns their number, and the hashes of their files: other jobs may have the same.
    """
    with sessions.begin() as session:
        old = (Job.state.in_(WITHOUT_RESULTS), Job.finished_at < clock(session) - age)
        some = select(Job.id, Job.tenant_id).where(*old).limit(limit).with_for_update(skip_locked=True)
        tenants = {row.id: row.tenant_id for row in session.execute(some)}
        if not tenants:
            return 0, set()
        of_these = delete(Artifact).where(Artifact.job_id.in_(tenants))
        files = session.execute(of_these.returning(Artifact.job_id, Artifact.sha256, Artifact.size)).all()
        session.execute(delete(Job).where(Job.id.in_(tenants)).execution_options(synchronize_session=False))
        freed = Counter[str]()
        for file in files:
            freed[tenants[file.job_id]] += file.size
        for tenant in sorted(freed):  # in the same order everywhere, so that no two wait for each other
            add_stored(session, tenant, -freed[tenant])
        return len(tenants), {file.sha256 for file in files}
