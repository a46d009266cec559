"""Event log of jobs, from which clients are notified: by streams, and by webhooks.

An event is written by the transaction that makes it happen (a transactional outbox), so no crash can lose it, or send
one that did not happen. That transaction holds the job's row, so a job's events are numbered in the order in which they
become visible: a reader up to a number has missed nothing before it. The same transaction addresses the event to the
webhook endpoints that want it.
"""

import uuid
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.models import Change, EventType, Job, JobEvent, JobKind, JobState, WebhookDelivery, WebhookEndpoint

KEPT = timedelta(days=30)  # retention of events
ENDED = (JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELED, JobState.EXPIRED)
TOLD = (JobKind.WATERMARK, JobKind.VERIFICATION)  # kinds whose ends are told; who converts is there, and waits
ENDINGS = tuple(EventType.of(kind, state) for kind in TOLD for state in ENDED)  # types sent by webhooks


def record(session: Session, job_id: str, change: Change, moment: datetime) -> Job:
    """Record the event of a transaction's change to a job. Call it once the job's row is changed, and so locked.

    Returns:
        The job as it is now.
    """
    counted = update(Job).where(Job.id == job_id).values(event_count=Job.event_count + 1)
    session.execute(counted.execution_options(synchronize_session=False))
    job = session.get_one(Job, job_id, populate_existing=True)
    event = EventType.of(job.kind, change)
    session.add(JobEvent(job_id=job_id, number=job.event_count, type=event, data=snapshot(job), created_at=moment))
    session.flush()
    if event in ENDINGS:
        _address(session, job, event, moment)
    return job


def _address(session: Session, job: Job, event: EventType, moment: datetime) -> None:
    """Create deliveries of a job's latest event to the webhook endpoints that want it."""
    enabled = (WebhookEndpoint.tenant_id == job.tenant_id, WebhookEndpoint.disabled_reason.is_(None))
    # The lock of a foreign key, before it is written: an endpoint that is being deleted must not fail the job.
    endpoints = select(WebhookEndpoint).where(*enabled).with_for_update(read=True, key_share=True)
    for endpoint in session.scalars(endpoints):
        if event in endpoint.events and (endpoint.url or job.webhook):
            session.add(
                WebhookDelivery(
                    id=str(uuid.uuid4()),
                    endpoint_id=endpoint.id,
                    tenant_id=endpoint.tenant_id,
                    job_id=job.id,
                    event_number=job.event_count,
                    url=None if endpoint.url else job.webhook,
                    due_at=moment,
                    created_at=moment,
                )
            )


def snapshot(job: Job) -> dict[str, Any]:
    """A job at this moment, under the names that the API has for its parts."""
    error = {"code": job.error_code, "detail": job.error_message, "remedy": job.error_remedy}
    return {
        "id": job.id,
        "state": job.state,
        "stage": job.stage,
        "progress": round(job.progress, 3),
        "created_at": rfc3339(job.created_at),
        "started_at": job.started_at and rfc3339(job.started_at),
        "finished_at": job.finished_at and rfc3339(job.finished_at),
        "expires_at": job.expires_at and rfc3339(job.expires_at),
        "attempts": job.attempts,
        "cached": job.cached,
        "metadata": {entry.key: entry.value for entry in job.metadata_entries},
        "error": error if job.error_code else None,
    }


def rfc3339(moment: datetime) -> str:
    """Format a time as the API does."""
    return moment.astimezone(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def read(sessions: sessionmaker[Session], job_id: str, after: int = 0) -> list[JobEvent]:
    """A job's events from the one after a number on."""
    events = select(JobEvent).where(JobEvent.job_id == job_id, JobEvent.number > after).order_by(JobEvent.number)
    with sessions() as session:
        return list(session.scalars(events))


def forget(sessions: sessionmaker[Session], before: datetime) -> None:
    """Delete the events of ended jobs from before a moment."""
    ended = select(Job.id).where(Job.state.not_in((JobState.QUEUED, JobState.RUNNING)))
    with sessions.begin() as session:
        session.execute(delete(JobEvent).where(JobEvent.created_at < before, JobEvent.job_id.in_(ended)))
