"""Jobs whose results wait for their credentials.

A worker hands a job over to the signers once its results are complete, and a signer ends it. Until then it is running,
without a lease that could expire: no result is lost because no signer runs. A signer that takes one has it for TAKEN;
should two have the same, one of them ends it, and the other one's credentials are not recorded.
"""

from datetime import timedelta

from sqlalchemy import select, update
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.clock import clock
from service.jobs.models import Job, JobState

TAKEN = timedelta(seconds=60)
PAUSE = timedelta(seconds=10)  # before another attempt


def take_due(sessions: sessionmaker[Session]) -> Job | None:
    """Take the job that has waited longest, or None; for TAKEN, no other signer gets it."""
    with sessions.begin() as session:
        moment = clock(session)
        due = (Job.sign_at <= moment, Job.state == JobState.RUNNING)
        first = select(Job.id).where(*due).order_by(Job.sign_at).limit(1).with_for_update(skip_locked=True)
        taken = update(Job).where(Job.id == first.scalar_subquery(), *due).values(sign_at=moment + TAKEN)
        job_id = session.scalar(taken.returning(Job.id).execution_options(synchronize_session=False))
        return session.get(Job, job_id) if job_id else None


def postpone(sessions: sessionmaker[Session], job: Job) -> None:
    """Release a job that was taken for another attempt, unless it has ended meanwhile."""
    with sessions.begin() as session:
        mine = (Job.id == job.id, Job.sign_at == job.sign_at)
        session.execute(update(Job).where(*mine).values(sign_at=clock(session) + PAUSE))
