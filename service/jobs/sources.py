"""Addresses of assets that a worker is to download.

An address may hold a signature that lets its bearer read the file. It is kept until the asset is in the store or the
job has ended, and no answer and no log line has it.
"""

from sqlalchemy import delete, exists, or_, select
from sqlalchemy.orm import Session, sessionmaker

from service.jobs.models import Artifact, ArtifactKind, Job, JobSource
from service.jobs.transitions import ACTIVE


def record(session: Session, job_id: str, url: str) -> None:
    """Record the address of a job's asset, in the transaction that records the job."""
    session.add(JobSource(job_id=job_id, url=url))


def url_of(sessions: sessionmaker[Session], job_id: str) -> str | None:
    """Address of a job's asset; None where none is known, or no more."""
    with sessions() as session:
        return session.scalar(select(JobSource.url).where(JobSource.job_id == job_id))


def forget(sessions: sessionmaker[Session]) -> None:
    """Delete addresses that are no longer needed."""
    has_input = exists().where(Artifact.job_id == JobSource.job_id, Artifact.kind == ArtifactKind.INPUT)
    ended = exists().where(Job.id == JobSource.job_id, Job.state.not_in(ACTIVE))
    with sessions.begin() as session:
        session.execute(delete(JobSource).where(or_(has_input, ended)).execution_options(synchronize_session=False))
