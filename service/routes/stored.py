"""Jobs and their files, for the routes of every kind of job."""

from typing import Any

from fastapi import Request, Response

from core.errors import MeshmarkError
from service import access
from service.access import Client
from service.delivery import deliver
from service.errors import ServiceErrorCode
from service.jobs import contents
from service.jobs.forgetting import drop_artifacts
from service.jobs.models import ArtifactKind, Job, JobKind, JobState
from service.problems import problem_responses
from service.state import AppState

UNKNOWN = problem_responses(*access.REFUSALS, ServiceErrorCode.NOT_FOUND, ServiceErrorCode.SERVICE_UNAVAILABLE)
TAG = {"ETag": {"description": "The SHA-256 of the whole, in quotes.", "schema": {"type": "string"}}}
NOT_THERE = problem_responses(
    *access.REFUSALS,
    ServiceErrorCode.NOT_FOUND,
    ServiceErrorCode.NOT_READY,
    ServiceErrorCode.JOB_FAILED,
    ServiceErrorCode.JOB_CANCELED,
    ServiceErrorCode.JOB_EXPIRED,
    ServiceErrorCode.RANGE_NOT_SATISFIABLE,
    ServiceErrorCode.PRECONDITION_FAILED,
    ServiceErrorCode.SERVICE_UNAVAILABLE,
)


def download(kind: ArtifactKind, schema: dict[str, Any], *media_types: str) -> dict[str, Any]:
    """Options of a route with a stored file of one of some media types, for its OpenAPI description."""
    content = {media_type: {"schema": schema} for media_type in media_types}
    return {
        "response_class": Response,
        "responses": {
            200: {"description": f"The {kind}.", "content": content, "headers": TAG},
            206: {"description": "The part that `Range` asks for.", "content": content, "headers": TAG},
            304: {"description": "The client has it: `If-None-Match` names its `ETag`.", "headers": TAG},
            307: {"description": "It is at the `Location`, for some minutes; where the service is set up so."},
            **NOT_THERE,
        },
    }


def find_job(state: AppState, client: Client, job_id: str, kind: JobKind = JobKind.WATERMARK) -> Job:
    """Find a client's job of some kind by its id.

    Raises:
        MeshmarkError: ``not_found``; also where it is another tenant's, or of another kind.
    """
    job = state.ledger.get(job_id, client.tenant) if job_id.isprintable() else None  # PostgreSQL takes no NUL
    if job is None or job.kind is not kind:
        raise _no_job(job_id)
    return job


def send_file(request: Request, state: AppState, job: Job, kind: ArtifactKind, headers: dict[str, str]) -> Response:
    """Response with a stored file of a job, and these headers where it carries the file.

    Raises:
        MeshmarkError: ``not_ready``, ``job_failed``, ``job_canceled``, ``job_expired`` or ``not_found``, there is no
            such file; as :func:`service.delivery.deliver`.
    """
    artifact = job.artifact(kind)
    if artifact is None:
        raise not_there(job, kind)
    try:
        return deliver(request, state.artifacts, state.content, artifact, headers)
    except FileNotFoundError:  # deleted since the ledger was read
        now = state.ledger.get(job.id, job.tenant_id)
        raise not_there(now, kind) if now else _no_job(job.id) from None


def delete_job(state: AppState, client: Client, job: Job) -> None:
    """Cancel a job if it has not ended, and delete its files and what its client said about it."""
    state.ledger.cancel(job.id, client.tenant)
    dropped = drop_artifacts(state.ledger.sessions, job.id, erase=True)
    unkept = set() if job.keeps_input else {item.sha256 for item in job.artifacts}  # dropped when it was canceled
    contents.discard(state.ledger, state.artifacts, dropped | unkept)


def _no_job(job_id: str) -> MeshmarkError:
    return MeshmarkError(
        ServiceErrorCode.NOT_FOUND,
        f"There is no job {job_id[:64]!r}.",
        "Use the id or the Location that POST gave.",
    )


def not_there(job: Job, kind: ArtifactKind) -> MeshmarkError:
    """The error that a job has no file of some kind, by its state."""
    match job.state:
        case JobState.QUEUED | JobState.RUNNING:
            return MeshmarkError(
                ServiceErrorCode.NOT_READY, f"The {kind} does not exist yet.", "Ask again when the job's links name it."
            )
        case JobState.FAILED:
            return MeshmarkError(
                ServiceErrorCode.JOB_FAILED,
                f"There is no {kind}, for the job failed: {job.error_message}",
                job.error_remedy or "",
            )
        case JobState.CANCELED:
            return MeshmarkError(
                ServiceErrorCode.JOB_CANCELED, f"There is no {kind}, for the job was canceled.", "Send the asset again."
            )
        case JobState.EXPIRED:
            return MeshmarkError(ServiceErrorCode.JOB_EXPIRED, f"The {kind} was deleted.", "Send the asset again.")
    return MeshmarkError(  # succeeded
        ServiceErrorCode.NOT_FOUND,
        f"The job was done without a {kind}.",
        "The job's links name what there is.",
    )
