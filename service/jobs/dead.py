"""Dead letters: jobs whose workers died at each attempt; to be listed, and retried."""

from sqlalchemy import select
from sqlalchemy.orm import Session, sessionmaker

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs import dropped
from service.jobs.artifacts import ArtifactStore
from service.jobs.ledger import OUTPUTS, Content, Ledger, Submission
from service.jobs.models import ArtifactKind, Job, JobState, Priority
from service.jobs.references import MissingContentError

WORKER_LOST = MeshmarkError(
    ServiceErrorCode.WORKER_LOST,
    "The worker that ran this job disappeared, each time it was tried.",
    "Send the asset again; if it happens again, this asset may exhaust the machine: reduce it, or report it.",
)
DEAD = (Job.state == JobState.FAILED, Job.error_code == ServiceErrorCode.WORKER_LOST)


def dead_jobs(sessions: sessionmaker[Session], tenant: str | None = None) -> list[Job]:
    """Dead jobs of a tenant, or of all of them; those that ended first come first."""
    dead = select(Job).where(*DEAD).order_by(Job.finished_at)
    with sessions() as session:
        return list(session.scalars(dead if tenant is None else dead.where(Job.tenant_id == tenant)))


def retry(ledger: Ledger, store: ArtifactStore, job_id: str) -> Job:
    """Create a new job of the same tenant from the inputs of a dead one, which stays as it ended.

    The new job of a dropped object takes the dead one's place: its results are written back, and its asset, if it was
    not downloaded yet, is downloaded from the bucket.

    Raises:
        LookupError: there is no such job, or its files are gone.
    """
    with ledger.sessions() as session:
        dead = session.scalar(select(Job).where(Job.id == job_id, *DEAD))
    if dead is None:
        raise LookupError(f"There is no job {job_id} that ended with worker_lost.")
    contents = {item.kind: Content(item.sha256, item.size) for item in dead.artifacts if item.kind not in OUTPUTS}
    submission = Submission(
        tenant=dead.tenant_id,
        kind=dead.kind,
        metadata={entry.key: entry.value for entry in dead.metadata_entries},
        webhook=dead.webhook,
        queue=dead.queue,
        priority=Priority(dead.priority),
        copy_of=dead.copy_of,
        condition=lambda session, successor: dropped.hand_over(session, job_id, successor),
    )
    try:
        if ArtifactKind.INPUT in contents or dropped.object_of(ledger.sessions, job_id):
            return ledger.create(dead.filename, dead.parameters, contents, store.has, submission, dead.result_key)
    except MissingContentError:
        pass
    raise LookupError(f"The files of job {job_id} are gone.")
