"""Routes of verifications: send a suspect file, follow its job, fetch the report and the page of evidence."""

from collections.abc import Mapping
from functools import partial
from pathlib import PurePath
from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, File, Form, Request, Response, UploadFile, status
from pydantic import ValidationError

from core.credentials.facts import LONGEST_SIDECAR
from core.errors import MeshmarkError
from core.verify.parameters import VerificationParameters, parse_verification
from core.verify.report import VerificationReport
from service import access
from service.access import Admitted, Client, GuardedRoute, PublicRoute
from service.asset_route import PublicAssetRoute
from service.delivery import disposition
from service.errors import ServiceErrorCode
from service.idempotency_key import parse_idempotency_key
from service.jobs.listing import Filters
from service.jobs.models import ArtifactKind, JobKind, Priority
from service.jobs.owners import owners
from service.metadata import parse_metadata, parse_pair
from service.orders import order_from
from service.problems import problem_responses
from service.routes import events
from service.routes.lists import (
    LISTING,
    CreatedAfterQuery,
    CreatedBeforeQuery,
    CursorQuery,
    LimitQuery,
    MetadataQuery,
    StateQuery,
    page_of,
)
from service.routes.stored import NOT_THERE, UNKNOWN, delete_job, download, find_job, not_there, send_file
from service.routes.taking import (
    OF_FILES,
    IdempotencyKeyHeader,
    MetadataField,
    PreferHeader,
    PriorityField,
    SourceUrlField,
    UploadIdField,
    WebhookField,
    accepted,
    answer_accepted,
)
from service.routes.verification_schemas import VerificationPage, VerificationView, WatermarksRead, view
from service.state import AppState, State
from service.submission import Accepted, submit
from service.waiting import Wait, preferred_wait

KIND = JobKind.VERIFICATION
PLACE: dict[str, Any] = {"prefix": "/v1/verifications", "tags": ["verifications"]}

router = APIRouter(**PLACE, route_class=GuardedRoute)
open_router = APIRouter(**PLACE, route_class=PublicRoute)
sending = APIRouter(**PLACE, route_class=PublicAssetRoute)

REPORT = {
    "$ref": "#/components/schemas/VerificationReport",
    "description": "`meshmark.verification/1`, as the manual's page on verification describes it.",
}
# A page with words and pictures of a hostile file: it runs nothing, fetches nothing, and has no origin.
SHOWN_SAFELY = {
    "Content-Security-Policy": "default-src 'none'; img-src data:; style-src 'unsafe-inline'; sandbox",
    "X-Content-Type-Options": "nosniff",
}

REFUSALS = problem_responses(
    *access.REFUSALS,
    *OF_FILES,
    ServiceErrorCode.NOT_READY,
)

SuspectPart = Annotated[
    UploadFile | None,
    File(
        description="The suspect file: GLB, glTF, OBJ, STL, PLY, OFF, 3MF or DAE; with its other files as a ZIP; or a "
        "picture of it as PNG, JPEG or WebP."
    ),
]
OriginalPart = Annotated[
    UploadFile | None,
    File(description="The asset without marks: the shape of the suspect file is compared with it."),
]
CredentialsPart = Annotated[
    UploadFile | None,
    File(description="The Content Credentials that came beside the suspect file: a C2PA manifest store."),
]
ParamsField = Annotated[
    str,
    Form(
        description="What to look for: a `VerificationParameters` object as JSON.",
        examples=['{"texts": ["SAMPLE"]}'],
        json_schema_extra={
            "contentMediaType": "application/json",
            "contentSchema": {"$ref": "#/components/schemas/VerificationParameters"},
        },
    ),
]


@sending.post(
    "",
    summary="Verify a suspect file",
    status_code=status.HTTP_202_ACCEPTED,
    responses=accepted(VerificationView) | REFUSALS,
)
async def create_verification(
    request: Request,
    response: Response,
    background: BackgroundTasks,
    state: State,
    client: Admitted,
    params: ParamsField = "{}",
    file: SuspectPart = None,
    original: OriginalPart = None,
    credentials: CredentialsPart = None,
    source_url: SourceUrlField = None,
    upload_id: UploadIdField = None,
    metadata: MetadataField = "{}",
    webhook: WebhookField = None,
    priority: PriorityField = "normal",
    idempotency_key: IdempotencyKeyHeader = None,
    prefer: PreferHeader = None,
) -> VerificationView:
    """Accept a suspect file for verification: its marks, metadata and credentials, alone or against an original."""

    def accept() -> Accepted:
        parameters, noted = parse_verification(params), parse_metadata(metadata)
        if client.is_public:
            needs_key = {
                "keep": parameters.keep,
                "watermark": parameters.watermark,
                "original": original,
                "source_url": source_url,
                "upload_id": upload_id,
                "metadata": noted,
                "webhook": webhook,
                "priority": priority != "normal",
                "Idempotency-Key": idempotency_key is not None,
            }
            parameters = _public(parameters, needs_key)
        stage = state.artifacts.stage
        order = order_from(
            state,
            client.tenant,
            parameters,
            noted,
            file=file,
            source_url=source_url,
            upload_id=upload_id,
            webhook=webhook,
            priority=Priority[priority.upper()],
            original=original and stage(original.file, limit=state.settings.max_upload_bytes, name="original"),
            sidecar=credentials and stage(credentials.file, limit=LONGEST_SIDECAR, name="credentials"),
            key=None if idempotency_key is None else parse_idempotency_key(idempotency_key),
        )
        return submit(state, order)

    taken = await state.intake.run(client.tenant, accept)
    created = view(request, taken.job)
    answer_accepted(state, taken, created.links.self, response, background)
    request.state.wait = Wait(taken.job, preferred_wait(prefer), partial(view, request))
    return created


def _public(parameters: VerificationParameters, needs_key: Mapping[str, object]) -> VerificationParameters:
    """Parameters of a request without a key, who has no texts of its own.

    Raises:
        MeshmarkError: ``invalid_api_key``, it asks for something that only a client with a key is given.
    """
    asked = [f"`{name}`" for name, value in needs_key.items() if value]
    if asked:
        raise MeshmarkError(
            ServiceErrorCode.INVALID_API_KEY,
            f"The request carries no API key, and asks for what needs one: {', '.join(asked)}.",
            "Leave it out, or send the header `Authorization: Bearer mm_...` with a key of yours.",
        )
    return parameters.model_copy(update={"texts": parameters.texts or ()})


@router.get("", summary="List verifications", responses=LISTING)
def list_verifications(
    request: Request,
    state: State,
    client: Admitted,
    job_state: StateQuery = None,
    created_after: CreatedAfterQuery = None,
    created_before: CreatedBeforeQuery = None,
    metadata: MetadataQuery = None,
    limit: LimitQuery = 20,
    cursor: CursorQuery = None,
) -> VerificationPage:
    """Your verifications, newest first."""
    pair = None if metadata is None else parse_pair(metadata)
    filters = Filters(job_state, created_after, created_before, pair, KIND)
    jobs, following = page_of(request, state, client, filters, limit, cursor)
    return VerificationPage(items=[view(request, job) for job in jobs], next=following)


@open_router.get("/{job_id}", summary="Read a verification", responses=UNKNOWN)
def read_verification(request: Request, state: State, client: Admitted, job_id: str) -> VerificationView:
    """Where the verification stands."""
    return view(request, find_job(state, client, job_id, KIND))


@router.delete(
    "/{job_id}", summary="Cancel or delete a verification", status_code=status.HTTP_204_NO_CONTENT, responses=UNKNOWN
)
async def delete_verification(state: State, client: Admitted, job_id: str) -> None:
    """Cancel the verification if it has not ended, and delete the file, the results, and what was said about it."""
    await state.deletions.run(partial(_delete, state, client, job_id))


def _delete(state: AppState, client: Client, job_id: str) -> None:
    delete_job(state, client, find_job(state, client, job_id, KIND))


@router.get("/{job_id}/events", summary="Follow a verification", **events.options(KIND))
async def stream_verification_events(
    state: State, client: Admitted, job_id: str, last_event_id: events.LastEventId = None
) -> Response:
    """What happens to the verification, from its beginning on, as server-sent events."""
    return await events.stream(state, client, job_id, last_event_id, KIND)


REPORT_FILE = download(ArtifactKind.REPORT, REPORT, "application/json")
LARGEST_REPORT = 2**24  # bytes; one has a few kilobytes
EVIDENCE_FILE = download(ArtifactKind.EVIDENCE, {"type": "string"}, "text/html")


@open_router.head(
    "/{job_id}/report",
    name="head_verification_report",
    summary="Download the report of a verification (headers only)",
    **REPORT_FILE,
)
@open_router.get("/{job_id}/report", summary="Download the report of a verification", **REPORT_FILE)
async def read_verification_report(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """Which marks were read and where, and what the metadata say."""
    return await state.content.run(partial(_report, request, state, client, job_id))


def _report(request: Request, state: AppState, client: Client, job_id: str) -> Response:
    job = find_job(state, client, job_id, KIND)
    name = disposition(PurePath(job.filename).stem + ".verification.json")
    headers = {"Content-Type": "application/json", "Content-Disposition": name}
    return send_file(request, state, job, ArtifactKind.REPORT, headers)


@router.get("/{job_id}/watermarks", summary="List watermarks whose texts were read", responses=NOT_THERE)
async def list_watermarks_of_verification(
    request: Request, state: State, client: Admitted, job_id: str
) -> WatermarksRead:
    """Watermarks of yours whose texts are those on the file as it was read, the likeliest first: whose copy it is."""
    return await state.content.run(partial(_watermarks, request, state, client, job_id))


def _watermarks(request: Request, state: AppState, client: Client, job_id: str) -> WatermarksRead:
    job = find_job(state, client, job_id, KIND)
    artifact = job.artifact(ArtifactKind.REPORT)
    if artifact is None or artifact.size > LARGEST_REPORT:
        raise not_there(job, ArtifactKind.REPORT)
    try:
        content = b"".join(state.artifacts.read(artifact.sha256, 0, artifact.size))
        report = VerificationReport.model_validate_json(content, extra="ignore")
    except (FileNotFoundError, ValidationError):  # deleted since the ledger was read, or no report
        raise not_there(job, ArtifactKind.REPORT) from None
    found = owners(state.ledger.sessions, client.tenant, [mark.text for mark in report.marks])
    return WatermarksRead.of(request, found)


@open_router.head(
    "/{job_id}/evidence",
    name="head_verification_evidence",
    summary="Download the page of evidence (headers only)",
    **EVIDENCE_FILE,
)
@open_router.get("/{job_id}/evidence", summary="Download the page of evidence", **EVIDENCE_FILE)
async def read_verification_evidence(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """A page for people with the marks, a picture of each, hashes and times, in one file."""
    return await state.content.run(partial(_evidence, request, state, client, job_id))


def _evidence(request: Request, state: AppState, client: Client, job_id: str) -> Response:
    job = find_job(state, client, job_id, KIND)
    name = disposition(PurePath(job.filename).stem + ".evidence.html", "inline")
    headers = {"Content-Type": "text/html; charset=utf-8", "Content-Disposition": name, **SHOWN_SAFELY}
    return send_file(request, state, job, ArtifactKind.EVIDENCE, headers)
