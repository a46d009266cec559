"""The watermark jobs: send an asset, follow its job, fetch what came of it, delete it."""

from contextlib import ExitStack
from functools import partial
from pathlib import PurePath
from typing import Annotated, Any

import structlog
from celery import Celery
from fastapi import APIRouter, BackgroundTasks, File, Form, Header, Query, Request, Response, UploadFile, status
from kombu.exceptions import KombuError
from sqlalchemy.orm import Session

from core.errors import ErrorCode, MeshmarkError
from core.parameters import parse_parameters
from service import access
from service.access import Admitted, Client, GuardedRoute
from service.delivery import deliver, disposition
from service.idempotency_key import parse_idempotency_key
from service.intake import check_asset, check_lettering
from service.jobs import contents, idempotency, queue
from service.jobs.ledger import Submission
from service.jobs.limits import check_active
from service.jobs.listing import Filters, list_jobs
from service.jobs.models import ArtifactKind, Job, JobState, Priority
from service.metadata import parse_metadata, parse_pair
from service.problems import problem_responses
from service.routes.schemas import JobPage, JobView, Moment, PriorityName
from service.state import AppState, State

router = APIRouter(prefix="/v1/watermarks", tags=["watermarks"], route_class=GuardedRoute)
log = structlog.get_logger(__name__)

MEDIA_TYPES = {
    ArtifactKind.MODEL: "model/gltf-binary",
    ArtifactKind.REPORT: "application/json",
    ArtifactKind.PREVIEW: "image/png",
}
SUFFIXES = {ArtifactKind.MODEL: ".glb", ArtifactKind.REPORT: ".report.json", ArtifactKind.PREVIEW: ".png"}

ACCEPTED: dict[int | str, dict[str, Any]] = {
    202: {
        "description": "The new job, or that of an earlier request with the same `Idempotency-Key`.",
        "headers": {
            "Location": {"description": "The job's own address.", "schema": {"type": "string"}},
            "Idempotent-Replayed": {
                "description": "`true` where an earlier request made the job.",
                "schema": {"type": "string", "enum": ["true"]},
            },
        },
    }
}
REFUSALS = problem_responses(
    *access.REFUSALS,
    ErrorCode.INVALID_REQUEST,
    ErrorCode.UPLOAD_TOO_LARGE,
    ErrorCode.UNSUPPORTED_MEDIA_TYPE,
    ErrorCode.UNKNOWN_FORMAT,
    ErrorCode.UNSUPPORTED_FORMAT,
    ErrorCode.MISSING_FILE,
    ErrorCode.EMPTY_FILE,
    ErrorCode.INVALID_PARAMETERS,
    ErrorCode.EMPTY_TEXT,
    ErrorCode.MISSING_GLYPHS,
    ErrorCode.INVALID_FONT,
    ErrorCode.INVALID_METADATA,
    ErrorCode.IDEMPOTENCY_KEY_IN_USE,
    ErrorCode.IDEMPOTENCY_KEY_REUSED,
    ErrorCode.TOO_MANY_JOBS,
    ErrorCode.MALFORMED_FILE,
    ErrorCode.TRUNCATED_FILE,
    ErrorCode.NO_FACES,
    ErrorCode.NON_FINITE_POSITIONS,
    ErrorCode.INDEX_OUT_OF_RANGE,
    ErrorCode.BUDGET_EXCEEDED,
    ErrorCode.UNSUPPORTED_FEATURE,
    ErrorCode.EXTERNAL_REFERENCE,
    ErrorCode.SERVICE_UNAVAILABLE,
)
LISTING = problem_responses(
    *access.REFUSALS, ErrorCode.INVALID_REQUEST, ErrorCode.INVALID_METADATA, ErrorCode.SERVICE_UNAVAILABLE
)
UNKNOWN = problem_responses(*access.REFUSALS, ErrorCode.NOT_FOUND, ErrorCode.SERVICE_UNAVAILABLE)
NOT_THERE = problem_responses(
    *access.REFUSALS,
    ErrorCode.NOT_FOUND,
    ErrorCode.NOT_READY,
    ErrorCode.JOB_FAILED,
    ErrorCode.JOB_CANCELED,
    ErrorCode.JOB_EXPIRED,
    ErrorCode.RANGE_NOT_SATISFIABLE,
    ErrorCode.SERVICE_UNAVAILABLE,
)


AssetPart = Annotated[
    UploadFile,
    File(description="The asset: GLB, glTF, OBJ, STL, PLY, OFF, 3MF or DAE; with its other files as a ZIP."),
]
FontPart = Annotated[UploadFile | None, File(description="A TrueType or OpenType font for the text.")]
ParamsField = Annotated[
    str,
    Form(
        description="What to emboss and how: a `Parameters` object as JSON.",
        examples=['{"text": "SAMPLE", "seed": 7}'],
        json_schema_extra={
            "contentMediaType": "application/json",
            "contentSchema": {"$ref": "#/components/schemas/Parameters"},
        },
    ),
]
MetadataField = Annotated[
    str,
    Form(
        description="What you want to find the job by: at most 16 short strings by name, as JSON.",
        examples=['{"order": "4711"}'],
        json_schema_extra={
            "contentMediaType": "application/json",
            "contentSchema": {"type": "object", "maxProperties": 16, "additionalProperties": {"type": "string"}},
        },
    ),
]
PriorityField = Annotated[
    PriorityName, Form(description="Which of your own waiting jobs goes first; other tenants' are not overtaken.")
]
IdempotencyKeyHeader = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        description="A text of your own, such as a UUID. For 24 hours, the same request with the same key is answered "
        "with the same job, and with `Idempotent-Replayed: true`.",
        examples=['"8e03978e-40d5-43dd-bc93-6894a57f9324"'],
    ),
]


@router.post("", status_code=status.HTTP_202_ACCEPTED, responses=ACCEPTED | REFUSALS)
def create_watermark(
    request: Request,
    response: Response,
    background: BackgroundTasks,
    state: State,
    client: Admitted,
    file: AssetPart,
    params: ParamsField,
    font: FontPart = None,
    metadata: MetadataField = "{}",
    priority: PriorityField = "normal",
    idempotency_key: IdempotencyKeyHeader = None,
) -> JobView:
    """Accept an asset for watermarking. What can be seen to be wrong at once is refused at once."""
    parameters, notes = parse_parameters(params), parse_metadata(metadata)
    key = None if idempotency_key is None else parse_idempotency_key(idempotency_key)
    settings, artifacts, sessions = state.settings, state.artifacts, state.ledger.sessions
    with ExitStack() as stack:
        staged = {
            ArtifactKind.INPUT: stack.enter_context(
                artifacts.stage(file.file, limit=settings.max_upload_bytes, name="file")
            )
        }
        if font is not None:
            staged[ArtifactKind.FONT] = stack.enter_context(
                artifacts.stage(font.file, limit=settings.max_font_bytes, name="font")
            )
        check_lettering(parameters, staged[ArtifactKind.FONT].path.read_bytes() if font is not None else None)
        check_asset(staged[ArtifactKind.INPUT].path, settings.budgets)
        wanted = parameters.model_dump(mode="json")
        reservation: idempotency.Reservation | None = None
        if key is not None:
            content: dict[str, Any] = {"parameters": wanted, "metadata": notes, "priority": priority}
            content |= {kind.value: item.sha256 for kind, item in staged.items()}
            reserved = idempotency.reserve(sessions, client.tenant, key, idempotency.fingerprint(content))
            if isinstance(reserved, str):
                response.headers["Idempotent-Replayed"] = "true"
                return _accepted(request, response, _job(state, client, reserved))
            reservation = reserved
            stack.enter_context(idempotency.given_back_on_failure(sessions, reservation))
        condition = partial(_check_and_settle, settings.max_active_jobs, client.tenant, reservation)
        waits_in = queue.queue_for(settings, staged[ArtifactKind.INPUT].size)
        submission = Submission(client.tenant, notes, condition, waits_in, Priority[priority.upper()])
        job = contents.create_job(state.ledger, artifacts, _plain_name(file.filename), wanted, staged, submission)
    background.add_task(_announce, state.queue, job)  # a broker that does not answer delays no client
    return _accepted(request, response, job)


@router.get("", responses=LISTING)
def list_watermarks(
    request: Request,
    state: State,
    client: Admitted,
    job_state: Annotated[JobState | None, Query(alias="state", description="Only jobs in this state.")] = None,
    created_after: Annotated[Moment | None, Query(description="Only jobs sent after this moment.")] = None,
    created_before: Annotated[Moment | None, Query(description="Only jobs sent before this moment.")] = None,
    metadata: Annotated[
        str | None,
        Query(description="Only jobs with this in their metadata, written `name:value`.", examples=["order:4711"]),
    ] = None,
    limit: Annotated[int, Query(ge=1, le=100, description="Most jobs to list.")] = 20,
    cursor: Annotated[str | None, Query(max_length=200, description="As `next` has it.")] = None,
) -> JobPage:
    """Your jobs, newest first."""
    pair = None if metadata is None else parse_pair(metadata)
    filters = Filters(job_state, created_after, created_before, pair)
    page = list_jobs(state.ledger.sessions, client.tenant, filters, limit, cursor)
    following = request.url.include_query_params(cursor=page.cursor)
    return JobPage(
        items=[_view(request, job) for job in page.jobs],
        next=f"{following.path}?{following.query}" if page.cursor else None,
    )


@router.get("/{job_id}", responses=UNKNOWN)
def read_watermark(request: Request, state: State, client: Admitted, job_id: str) -> JobView:
    """Where the job stands."""
    return _view(request, _job(state, client, job_id))


@router.delete("/{job_id}", status_code=status.HTTP_204_NO_CONTENT, responses=UNKNOWN)
def delete_watermark(state: State, client: Admitted, job_id: str) -> None:
    """Cancel the job if it has not ended, and delete the uploaded asset and everything made from it."""
    _job(state, client, job_id)
    state.ledger.cancel(job_id, client.tenant)
    contents.discard(state.ledger, state.artifacts, state.ledger.drop_artifacts(job_id))


def _download(kind: ArtifactKind) -> dict[str, Any]:
    content = {MEDIA_TYPES[kind]: {"schema": {"type": "string", "format": "binary"}}}
    return {
        "response_class": Response,
        "responses": {
            200: {"description": f"The {kind}.", "content": content},
            206: {"description": "The part that `Range` asks for.", "content": content},
            304: {"description": "The client has it: `If-None-Match` names its `ETag`."},
            307: {"description": "It is at the `Location`, for some minutes; where the service is set up so."},
            **NOT_THERE,
        },
    }


@router.head("/{job_id}/model", name="head_model", **_download(ArtifactKind.MODEL))
@router.get("/{job_id}/model", **_download(ArtifactKind.MODEL))
def read_model(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The watermarked GLB; there from stage `evaluating` on."""
    return _deliver(request, state, client, job_id, ArtifactKind.MODEL)


@router.head("/{job_id}/report", name="head_report", **_download(ArtifactKind.REPORT))
@router.get("/{job_id}/report", **_download(ArtifactKind.REPORT))
def read_report(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """Where the watermarks are, and what they measure."""
    return _deliver(request, state, client, job_id, ArtifactKind.REPORT)


@router.head("/{job_id}/preview", name="head_preview", **_download(ArtifactKind.PREVIEW))
@router.get("/{job_id}/preview", **_download(ArtifactKind.PREVIEW))
def read_preview(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """Pictures of the watermarked asset from eight sides, as one PNG."""
    return _deliver(request, state, client, job_id, ArtifactKind.PREVIEW)


def _check_and_settle(
    most: int, tenant: str, reservation: idempotency.Reservation | None, session: Session, job_id: str
) -> None:
    """What must hold for a job to be recorded, and what is recorded with it."""
    if most:
        check_active(session, tenant, most)
    if reservation is not None:
        idempotency.settle(session, reservation, job_id)


def _announce(broker: Celery, job: Job) -> None:
    try:
        queue.send(broker, job.id, job.queue)
    except (KombuError, OSError) as error:
        log.error("the broker does not answer; a worker's sweeper will find the job", job=job.id, error=str(error))


def _job(state: AppState, client: Client, job_id: str) -> Job:
    job = state.ledger.get(job_id, client.tenant) if job_id.isprintable() else None  # PostgreSQL takes no NUL
    if job is None:
        raise MeshmarkError(
            ErrorCode.NOT_FOUND, f"There is no job {job_id[:64]!r}.", "Use the id or the Location that POST gave."
        )
    return job


def _accepted(request: Request, response: Response, job: Job) -> JobView:
    view = _view(request, job)
    response.headers["Location"] = view.links.self
    return view


def _view(request: Request, job: Job) -> JobView:
    return JobView.of(job, request.app.url_path_for("read_watermark", job_id=job.id))


def _plain_name(filename: str | None) -> str:
    """The last part of what the client calls its file, without anything that does not print."""
    name = PurePath((filename or "").replace("\\", "/")).name
    return "".join(character for character in name if character.isprintable())[-120:] or "asset"


def _deliver(request: Request, state: AppState, client: Client, job_id: str, kind: ArtifactKind) -> Response:
    job = _job(state, client, job_id)
    artifact = job.artifact(kind)
    if artifact is None:
        raise _not_there(job, kind)
    name = PurePath(job.filename).stem + ".watermarked" + SUFFIXES[kind]
    headers = {"Content-Type": MEDIA_TYPES[kind], "Content-Disposition": disposition(name)}
    try:
        return deliver(request, state.artifacts, artifact, headers)
    except FileNotFoundError:  # deleted since the look at the ledger
        raise _not_there(_job(state, client, job_id), kind) from None


def _not_there(job: Job, kind: ArtifactKind) -> MeshmarkError:
    match job.state:
        case JobState.QUEUED | JobState.RUNNING:
            return MeshmarkError(
                ErrorCode.NOT_READY, f"The {kind} does not exist yet.", "Ask again when the job's links name it."
            )
        case JobState.FAILED:
            return MeshmarkError(
                ErrorCode.JOB_FAILED,
                f"There is no {kind}, for the job failed: {job.error_message}",
                job.error_remedy or "",
            )
        case JobState.CANCELED:
            return MeshmarkError(
                ErrorCode.JOB_CANCELED, f"There is no {kind}, for the job was canceled.", "Send the asset again."
            )
        case JobState.EXPIRED:
            return MeshmarkError(ErrorCode.JOB_EXPIRED, f"The {kind} was deleted.", "Send the asset again.")
    return MeshmarkError(  # succeeded
        ErrorCode.NOT_FOUND,
        f"The job was done without a {kind}.",
        "The job's links name what there is.",
    )
