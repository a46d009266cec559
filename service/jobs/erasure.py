"""What a client said about a job goes with its files when the client deletes it; that there was a job stays.

What stays is its id, its state and times, and the code of its error. An event that is yet to be told by a webhook keeps
what it has to tell until it is told, or given up.
"""

from sqlalchemy import delete, exists, select, update
from sqlalchemy.orm import Session

from service.jobs.models import DeliveryState, Job, JobEvent, MetadataEntry, WebhookDelivery

ERASED = {"detail": "What it was is erased with the job's files.", "remedy": "Send the asset again."}


def erase_job(session: Session, job_id: str) -> None:
    """Erase what was said about a job that has ended, in a transaction that has locked it."""
    job = session.get_one(Job, job_id, populate_existing=True)
    values = {"erased": True, "filename": "erased", "parameters": {}, "webhook": None, "result_key": None}
    if job.error_code:
        values |= {"error_message": ERASED["detail"], "error_remedy": ERASED["remedy"]}
    session.execute(delete(MetadataEntry).where(MetadataEntry.job_id == job_id))
    session.execute(update(Job).where(Job.id == job_id).values(**values).execution_options(synchronize_session=False))
    erase_events(session, job_id)


def erase_events(session: Session, job_id: str) -> None:
    """Erase what was said about a job from those of its events that are not to be told any more."""
    to_be_told = exists().where(
        WebhookDelivery.job_id == JobEvent.job_id,
        WebhookDelivery.event_number == JobEvent.number,
        WebhookDelivery.state == DeliveryState.PENDING,
    )
    for event in session.scalars(select(JobEvent).where(JobEvent.job_id == job_id, ~to_be_told)):
        error = event.data.get("error")
        event.data = {**event.data, "metadata": {}, "error": error and {**error, **ERASED}}
