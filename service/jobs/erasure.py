"""Erasure of a job's client data, with its files, when the client deletes it; the job's row stays.

Its id, its state and times, and the code of its error stay. An event with a pending webhook keeps its content until the
webhook is delivered or given up.
"""

from sqlalchemy import delete, exists, select, update
from sqlalchemy.orm import Session

from service.jobs.models import DeliveryState, Job, JobEvent, MetadataEntry, WebhookDelivery

ERASED = {"detail": "What it was is erased with the job's files.", "remedy": "Send the asset again."}


def erase_job(session: Session, job_id: str) -> None:
    """Erase the client's data of a job that has ended, in a transaction that has locked it."""
    job = session.get_one(Job, job_id, populate_existing=True)
    values = {"erased": True, "filename": "erased", "parameters": {}, "webhook": None, "result_key": None}
    if job.error_code:
        values |= {"error_message": ERASED["detail"], "error_remedy": ERASED["remedy"]}
    session.execute(delete(MetadataEntry).where(MetadataEntry.job_id == job_id))
    session.execute(update(Job).where(Job.id == job_id).values(**values).execution_options(synchronize_session=False))
    erase_events(session, job_id)


def erase_events(session: Session, job_id: str) -> None:
    """Erase the client's data from those events of a job that have no pending webhook."""
    to_be_told = exists().where(
        WebhookDelivery.job_id == JobEvent.job_id,
        WebhookDelivery.event_number == JobEvent.number,
        WebhookDelivery.state == DeliveryState.PENDING,
    )
    for event in session.scalars(select(JobEvent).where(JobEvent.job_id == job_id, ~to_be_told)):
        error = event.data.get("error")
        event.data = {**event.data, "metadata": {}, "error": error and {**error, **ERASED}}
