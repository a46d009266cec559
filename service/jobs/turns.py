"""Fair queue: the least recently served tenant is next, and of its own jobs that of highest priority, then the oldest.

Guaranteed in each queue: a free worker goes to that tenant, of those with a waiting job, whose last start is longest
ago. However many jobs a tenant sends and whatever their priority, each of n tenants with waiting jobs gets every n-th
start. A message in the broker only says that a job waits in a queue; as it is not about the job that is started, a late
tenant passes ten thousand messages of another one.
"""

from sqlalchemy import CTE, ColumnElement, func, select
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.ledger import Ledger
from service.jobs.models import Job, JobState, Queue


def claim_next(ledger: Ledger, queue: Queue, lease_seconds: float) -> Job | None:
    """Claim the next job of a queue, or None where none waits."""
    while job_id := next_job(ledger.sessions, queue):
        if job := ledger.claim(job_id, lease_seconds):
            return job
    return None


def next_job(sessions: sessionmaker[Session], queue: Queue) -> str | None:
    """Id of the job that is next in a queue at this moment."""
    tenants = _waiting_tenants(queue)
    last_start = select(func.max(Job.started_at)).where(Job.queue == queue, Job.tenant_id == tenants.c.id)
    whose_turn = (
        select(tenants.c.id)
        .where(tenants.c.id.is_not(None))
        .order_by(last_start.scalar_subquery().nulls_first(), tenants.c.id)
        .limit(1)
    )
    first = (
        select(Job.id)
        .where(*_waiting(queue), Job.tenant_id == whose_turn.scalar_subquery())
        .order_by(Job.priority, Job.created_at, Job.id)
        .limit(1)
    )
    with sessions() as session:
        return session.scalar(first)


def queue_of(sessions: sessionmaker[Session], job_id: str) -> Queue | None:
    """Queue that a job belongs to; None where there is no such job."""
    with sessions() as session:
        return session.scalar(select(Job.queue).where(Job.id == job_id))


def _waiting(queue: Queue) -> tuple[ColumnElement[bool], ...]:
    return (Job.state == JobState.QUEUED, Job.queue == queue, ~Job.held)


def _waiting_tenants(queue: Queue) -> CTE:
    """Tenants with a waiting job, then one NULL; each is one step in the index, however many jobs it has."""
    first = select(func.min(Job.tenant_id).label("id")).where(*_waiting(queue)).cte("waiting_tenants", recursive=True)
    following = select(func.min(Job.tenant_id)).where(*_waiting(queue), Job.tenant_id > first.c.id).scalar_subquery()
    return first.union_all(select(following).select_from(first).where(first.c.id.is_not(None)))
