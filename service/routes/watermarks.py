"""Routes of watermark jobs: send an asset, follow its job, fetch its results, delete it."""

from functools import partial
from pathlib import PurePath
from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, File, Form, Header, Query, Request, Response, UploadFile, status

from core.errors import ErrorCode, MeshmarkError
from core.parameters import parse_parameters
from service import access
from service.access import Admitted, Client, GuardedRoute
from service.asset_route import AssetRoute
from service.delivery import deliver, disposition
from service.errors import ServiceErrorCode
from service.idempotency_key import parse_idempotency_key
from service.jobs import contents
from service.jobs.listing import Filters, list_jobs
from service.jobs.models import ArtifactKind, Job, JobState, Priority
from service.metadata import PAIR, parse_metadata, parse_pair
from service.orders import order_from
from service.problems import problem_responses
from service.routes.schemas import JobPage, JobView, Moment, PriorityName, view
from service.state import AppState, State
from service.submission import Accepted, submit

router = APIRouter(prefix="/v1/watermarks", tags=["watermarks"], route_class=GuardedRoute)
sending = APIRouter(prefix="/v1/watermarks", tags=["watermarks"], route_class=AssetRoute)

MEDIA_TYPES = {
    ArtifactKind.MODEL: "model/gltf-binary",
    ArtifactKind.REPORT: "application/json",
    ArtifactKind.PREVIEW: "image/png",
    ArtifactKind.CREDENTIALS: "application/c2pa",
}
CONTENT: dict[ArtifactKind, dict[str, Any]] = {
    ArtifactKind.MODEL: {"type": "string", "format": "binary"},
    ArtifactKind.REPORT: {
        "$ref": "#/components/schemas/Report",
        "description": "`meshmark.report/1`, as the manual's page on the report describes it.",
    },
    ArtifactKind.PREVIEW: {"type": "string", "format": "binary"},
    ArtifactKind.CREDENTIALS: {"type": "string", "format": "binary"},
}
SUFFIXES = {
    ArtifactKind.MODEL: ".glb",
    ArtifactKind.REPORT: ".report.json",
    ArtifactKind.PREVIEW: ".png",
    ArtifactKind.CREDENTIALS: ".c2pa",
}

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
    ServiceErrorCode.UPLOAD_TOO_LARGE,
    ServiceErrorCode.UNSUPPORTED_MEDIA_TYPE,
    ErrorCode.UNKNOWN_FORMAT,
    ErrorCode.UNSUPPORTED_FORMAT,
    ErrorCode.MISSING_FILE,
    ServiceErrorCode.NOT_FOUND,
    ServiceErrorCode.UPLOAD_NOT_SENT,
    ServiceErrorCode.UPLOAD_MISMATCH,
    ServiceErrorCode.UPLOAD_EXPIRED,
    ServiceErrorCode.SOURCE_URL_DISABLED,
    ServiceErrorCode.ADDRESS_REFUSED,
    ErrorCode.EMPTY_FILE,
    ErrorCode.INVALID_PARAMETERS,
    ErrorCode.EMPTY_TEXT,
    ErrorCode.MISSING_GLYPHS,
    ErrorCode.INVALID_FONT,
    ErrorCode.INVALID_LOGO,
    ServiceErrorCode.INVALID_METADATA,
    ServiceErrorCode.NO_WEBHOOK_SECRET,
    ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE,
    ServiceErrorCode.IDEMPOTENCY_KEY_REUSED,
    ServiceErrorCode.TOO_MANY_JOBS,
    ServiceErrorCode.TOO_MANY_UPLOADS,
    ServiceErrorCode.REQUEST_TIMEOUT,
    ServiceErrorCode.QUOTA_EXCEEDED,
    ErrorCode.MALFORMED_FILE,
    ErrorCode.TRUNCATED_FILE,
    ErrorCode.NO_FACES,
    ErrorCode.NON_FINITE_POSITIONS,
    ErrorCode.INDEX_OUT_OF_RANGE,
    ErrorCode.BUDGET_EXCEEDED,
    ErrorCode.UNSUPPORTED_FEATURE,
    ErrorCode.EXTERNAL_REFERENCE,
    ErrorCode.ENGINE_CRASHED,
    ErrorCode.INTERNAL_ERROR,
    ServiceErrorCode.SERVICE_UNAVAILABLE,
)
LISTING = problem_responses(
    *access.REFUSALS, ErrorCode.INVALID_REQUEST, ServiceErrorCode.INVALID_METADATA, ServiceErrorCode.SERVICE_UNAVAILABLE
)
UNKNOWN = problem_responses(*access.REFUSALS, ServiceErrorCode.NOT_FOUND, ServiceErrorCode.SERVICE_UNAVAILABLE)
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


AssetPart = Annotated[
    UploadFile | None,
    File(description="The asset: GLB, glTF, OBJ, STL, PLY, OFF, 3MF or DAE; with its other files as a ZIP."),
]
SourceUrlField = Annotated[
    str | None,
    Form(
        description="In place of `file`: the https address of the asset, where the service is set up so. It is "
        "fetched by a worker; redirects are not followed. The address is not shown again to anybody.",
        examples=["https://files.example/lantern.glb?signature=..."],
    ),
]
FontPart = Annotated[UploadFile | None, File(description="A TrueType or OpenType font for the text.")]
LogoPart = Annotated[UploadFile | None, File(description="A logo: an SVG, alone or beside the text.")]
UploadIdField = Annotated[
    str | None,
    Form(
        description="In place of `file`: the id of an upload, see POST /v1/uploads.",
        examples=["4c8a9d52-9a0e-4d57-8c39-5d8f4c1f0a11"],
    ),
]
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
WebhookField = Annotated[
    str | None,
    Form(
        description="Where to send a webhook when the job ends. It is signed with the secret of your webhook endpoint "
        "that has no `url`, which must exist.",
        max_length=2048,
        examples=["https://shop.example/hooks/4711"],
    ),
]
PriorityField = Annotated[
    PriorityName,
    Form(
        description="Which of your own waiting jobs goes first; other tenants' are not overtaken.", examples=["normal"]
    ),
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

CacheQuery = Annotated[
    bool,
    Query(
        description="Whether results will do that exist already: where you had the same asset watermarked with the "
        "same parameters, font and logo, and still have the results, the new job has succeeded at once."
    ),
]


@sending.post("", status_code=status.HTTP_202_ACCEPTED, responses=ACCEPTED | REFUSALS)
async def create_watermark(
    request: Request,
    response: Response,
    background: BackgroundTasks,
    state: State,
    client: Admitted,
    params: ParamsField,
    file: AssetPart = None,
    source_url: SourceUrlField = None,
    upload_id: UploadIdField = None,
    font: FontPart = None,
    logo: LogoPart = None,
    metadata: MetadataField = "{}",
    webhook: WebhookField = None,
    priority: PriorityField = "normal",
    idempotency_key: IdempotencyKeyHeader = None,
    cache: CacheQuery = True,
) -> JobView:
    """Accept an asset for watermarking. What can be seen to be wrong at once is refused at once."""

    def accept() -> Accepted:
        order = order_from(
            state,
            client.tenant,
            parse_parameters(params),
            parse_metadata(metadata),
            file=file,
            source_url=source_url,
            upload_id=upload_id,
            webhook=webhook,
            priority=Priority[priority.upper()],
            font=font and state.artifacts.stage(font.file, limit=state.settings.max_font_bytes, name="font"),
            logo=logo and state.artifacts.stage(logo.file, limit=state.settings.max_logo_bytes, name="logo"),
            key=None if idempotency_key is None else parse_idempotency_key(idempotency_key),
            cache=cache,
        )
        return submit(state, order)

    job, replayed = await state.intake.run(client.tenant, accept)
    if replayed:
        response.headers["Idempotent-Replayed"] = "true"
    else:
        background.add_task(state.announcer.announce, job)  # the client does not wait for it
    accepted = view(request, job)
    response.headers["Location"] = accepted.links.self
    return accepted


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
        Query(
            description="Only jobs with this in their metadata, written `name:value`.",
            examples=["order:4711"],
            json_schema_extra={"pattern": PAIR},
        ),
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
        items=[view(request, job) for job in page.jobs],
        next=f"{following.path}?{following.query}" if page.cursor else None,
    )


@router.get("/{job_id}", responses=UNKNOWN)
def read_watermark(request: Request, state: State, client: Admitted, job_id: str) -> JobView:
    """Where the job stands."""
    return view(request, find_job(state, client, job_id))


@router.delete("/{job_id}", status_code=status.HTTP_204_NO_CONTENT, responses=UNKNOWN)
async def delete_watermark(state: State, client: Admitted, job_id: str) -> None:
    """Cancel the job if it has not ended, and delete the asset, everything made from it, and what was said about it."""
    await state.deletions.run(partial(_delete, state, client, job_id))


def _delete(state: AppState, client: Client, job_id: str) -> None:
    find_job(state, client, job_id)
    state.ledger.cancel(job_id, client.tenant)
    contents.discard(state.ledger, state.artifacts, state.ledger.drop_artifacts(job_id, erase=True))


def _download(kind: ArtifactKind) -> dict[str, Any]:
    content: dict[str, Any] = {MEDIA_TYPES[kind]: {"schema": CONTENT[kind]}}
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
async def read_model(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The watermarked GLB; there from stage `evaluating` on."""
    return await _deliver(request, state, client, job_id, ArtifactKind.MODEL)


@router.head("/{job_id}/report", name="head_report", **_download(ArtifactKind.REPORT))
@router.get("/{job_id}/report", **_download(ArtifactKind.REPORT))
async def read_report(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """Where the watermarks are, and what they measure."""
    return await _deliver(request, state, client, job_id, ArtifactKind.REPORT)


@router.head("/{job_id}/preview", name="head_preview", **_download(ArtifactKind.PREVIEW))
@router.get("/{job_id}/preview", **_download(ArtifactKind.PREVIEW))
async def read_preview(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """Pictures of the watermarked asset from eight sides, as one PNG."""
    return await _deliver(request, state, client, job_id, ArtifactKind.PREVIEW)


@router.head("/{job_id}/credentials", name="head_credentials", **_download(ArtifactKind.CREDENTIALS))
@router.get("/{job_id}/credentials", **_download(ArtifactKind.CREDENTIALS))
async def read_credentials(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The model's Content Credentials, a C2PA manifest store beside it; where the service signs its results."""
    return await _deliver(request, state, client, job_id, ArtifactKind.CREDENTIALS)


def find_job(state: AppState, client: Client, job_id: str) -> Job:
    """Find a client's job by its id.

    Raises:
        MeshmarkError: ``not_found``; also where it is another tenant's.
    """
    job = state.ledger.get(job_id, client.tenant) if job_id.isprintable() else None  # PostgreSQL takes no NUL
    if job is None:
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND,
            f"There is no job {job_id[:64]!r}.",
            "Use the id or the Location that POST gave.",
        )
    return job


async def _deliver(request: Request, state: AppState, client: Client, job_id: str, kind: ArtifactKind) -> Response:
    return await state.content.run(partial(_delivery, request, state, client, job_id, kind))


def _delivery(request: Request, state: AppState, client: Client, job_id: str, kind: ArtifactKind) -> Response:
    job = find_job(state, client, job_id)
    artifact = job.artifact(kind)
    if artifact is None:
        raise _not_there(job, kind)
    name = PurePath(job.filename).stem + ".watermarked" + SUFFIXES[kind]
    headers = {"Content-Type": MEDIA_TYPES[kind], "Content-Disposition": disposition(name)}
    try:
        response = deliver(request, state.artifacts, state.content, artifact, headers)
    except FileNotFoundError:  # deleted since the ledger was read
        raise _not_there(find_job(state, client, job_id), kind) from None
    if kind is ArtifactKind.MODEL and job.artifact(ArtifactKind.CREDENTIALS):
        place = request.app.url_path_for("read_credentials", job_id=job_id)
        response.headers["Link"] = f'<{place}>; rel="c2pa-manifest"'  # C2PA 2.2, section 15.5.3.2
    return response


def _not_there(job: Job, kind: ArtifactKind) -> MeshmarkError:
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
