"""Routes of a job's copies: ask for more, list all."""

import json
from functools import partial
from itertools import chain
from typing import Annotated, Any, Self

from fastapi import APIRouter, BackgroundTasks, Header, Query, Request, Response, status
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from core.validation import StrictModel
from service import access
from service.access import Admitted, Client, GuardedRoute
from service.archive import Entry, archived
from service.copies import Copies, check_copies, stem_of
from service.delivery import disposition
from service.errors import ServiceErrorCode
from service.idempotency_key import parse_idempotency_key
from service.jobs.copies import list_copies
from service.jobs.models import ArtifactKind, Job, JobKind, JobState
from service.jobs.transitions import ACTIVE
from service.problems import problem_responses
from service.routes.lists import CursorQuery, LimitQuery
from service.routes.schemas import EXAMPLE, ErrorView, LinksView, common, links
from service.routes.stored import UNKNOWN, find_job, not_there
from service.routes.taking import HEADERS, IdempotencyKeyHeader
from service.state import AppState, State
from service.submission import Accepted, submit_copies
from service.webhooks.endpoints import check_job_webhook

NDJSON = "application/x-ndjson"
ZIP = "application/zip"
INDEX = "copies.ndjson"  # the last file of an archive

router = APIRouter(prefix="/v1/watermarks", tags=["watermarks"], route_class=GuardedRoute)

REFUSALS = problem_responses(
    *access.REFUSALS,
    ErrorCode.INVALID_REQUEST,
    ServiceErrorCode.UNSUPPORTED_MEDIA_TYPE,
    ServiceErrorCode.UPLOAD_TOO_LARGE,
    ServiceErrorCode.REQUEST_TIMEOUT,
    ErrorCode.INVALID_PARAMETERS,
    ErrorCode.EMPTY_TEXT,
    ErrorCode.MISSING_GLYPHS,
    ServiceErrorCode.INVALID_METADATA,
    ServiceErrorCode.NO_WEBHOOK_SECRET,
    ServiceErrorCode.ADDRESS_REFUSED,
    ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE,
    ServiceErrorCode.IDEMPOTENCY_KEY_REUSED,
    ServiceErrorCode.NOT_FOUND,
    ServiceErrorCode.NOT_READY,
    ServiceErrorCode.JOB_FAILED,
    ServiceErrorCode.JOB_CANCELED,
    ServiceErrorCode.JOB_EXPIRED,
    ServiceErrorCode.TOO_MANY_JOBS,
    ServiceErrorCode.QUOTA_EXCEEDED,
    ServiceErrorCode.SERVICE_UNAVAILABLE,
)

COPY: JsonDict = {
    "id": "0d3a9a4e-7f0b-4c1e-9f39-0d2b1a7c9d12",
    "text": "ORDER-4711",
    "state": "queued",
    "stage": None,
    "progress": 0.0,
    "metadata": {"customer": "17"},
    "error": None,
    "links": {
        name: path and str(path).replace(str(EXAMPLE["id"]), "0d3a9a4e-7f0b-4c1e-9f39-0d2b1a7c9d12")
        for name, path in dict(EXAMPLE["links"]).items()  # type: ignore[arg-type]
    }
    | {"model": None},
}


class CopiesWanted(StrictModel):
    """Copies to make of a job that has succeeded."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"copies": [{"text": "ORDER-4711", "metadata": {"customer": "17"}}]}]}
    )

    copies: Copies
    webhook: Annotated[
        str | None,
        Field(max_length=2048, description="Where to send a webhook when a copy ends, as in POST /v1/watermarks."),
    ] = None


class CopyView(BaseModel):
    """A copy: a job of its own, in brief."""

    model_config = ConfigDict(json_schema_extra={"examples": [COPY]})

    id: Annotated[str, Field(description="Its own, as a watermark job.")]
    text: Annotated[str | None, Field(description="What it says; null once it is deleted.")]
    state: JobState
    stage: Annotated[str | None, Field(description="What a running copy does at the moment.")]
    progress: Annotated[float, Field(ge=0, le=1, description="How much of it is done.")]
    metadata: Annotated[dict[str, str], Field(description="What the client noted about it.")]
    error: ErrorView | None
    links: LinksView

    @classmethod
    def of(cls, request: Request, job: Job) -> Self:
        """Response model of a copy."""
        fields = common(job)
        return cls(
            id=job.id,
            text=None if job.erased else str(job.parameters["text"]),
            state=job.state,
            stage=job.stage,
            progress=fields["progress"],
            metadata=fields["metadata"],
            error=fields["error"],
            links=links(job, request.app.url_path_for("read_watermark", job_id=job.id)),
        )


class CopiesMade(BaseModel):
    """The copies that a request asked for, in its order."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"items": [COPY]}]})

    items: list[CopyView]


class CopyPage(BaseModel):
    """Some of the copies of a job, in the order in which they were asked for."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"items": [COPY], "next": None}]})

    items: list[CopyView]
    next: Annotated[str | None, Field(description="Where the list goes on; null: this is its end.")]


MADE: dict[int | str, dict[str, Any]] = {
    202: {
        "description": "The new copies, or those of an earlier request with the same `Idempotency-Key`.",
        "headers": {name: HEADERS[name] for name in ("Location", "Idempotent-Replayed")},
    }
}
LISTED: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "Some of the copies, or with `Accept: application/x-ndjson` all, a line of JSON for each.",
        "content": {NDJSON: {"schema": {"type": "string", "description": "Each line is a `CopyView`."}}},
    }
}
ARCHIVED: dict[int | str, dict[str, Any]] = {
    200: {"description": "The archive.", "content": {ZIP: {"schema": {"type": "string", "format": "binary"}}}}
}
CacheQuery = Annotated[
    bool,
    Query(
        description="Whether results will do that an equal copy of yours has: then the new one has succeeded at once."
    ),
]
AcceptHeader = Annotated[
    str | None,
    Header(
        alias="Accept",
        description="`application/x-ndjson` asks for the index of all copies in one answer.",
        examples=[NDJSON],
        include_in_schema=False,
    ),
]


@router.post(
    "/{job_id}/copies",
    summary="Make copies of a watermark",
    status_code=status.HTTP_202_ACCEPTED,
    responses=MADE | REFUSALS,
)
async def create_copies(
    request: Request,
    response: Response,
    background: BackgroundTasks,
    state: State,
    client: Admitted,
    job_id: str,
    wanted: CopiesWanted,
    idempotency_key: IdempotencyKeyHeader = None,
    cache: CacheQuery = True,
) -> CopiesMade:
    """Make copies of the job's asset with other texts at the places of its marks. Each is a job of its own."""

    def accept() -> Accepted:
        parent = find_job(state, client, job_id)
        if parent.state is not JobState.SUCCEEDED or parent.artifact(ArtifactKind.PLAN) is None:
            raise not_there(parent, ArtifactKind.PLAN)
        if wanted.webhook is not None:
            sessions, policy = state.ledger.sessions, state.settings.outbound
            check_job_webhook(sessions, client.tenant, wanted.webhook, policy, JobKind.WATERMARK)
        logo, font = (parent.artifact(kind) is not None for kind in (ArtifactKind.LOGO, ArtifactKind.FONT))
        parameters = Parameters.model_validate(parent.parameters)
        checked = check_copies(wanted.copies, parameters, logo=logo, font=font)
        key = None if idempotency_key is None else parse_idempotency_key(idempotency_key)
        return submit_copies(state, parent, checked, wanted.webhook, key, cache)

    taken = await state.intake.run(client.tenant, accept)
    response.headers["Location"] = request.app.url_path_for("list_copies_of_watermark", job_id=job_id)
    if taken.replayed:
        response.headers["Idempotent-Replayed"] = "true"
    else:
        for job in taken.started:
            if job.state is JobState.QUEUED:
                background.add_task(state.announcer.announce, job)
    return CopiesMade(items=[CopyView.of(request, job) for job in taken.started])


@router.get(
    "/{job_id}/copies",
    name="list_copies_of_watermark",
    summary="List copies of a watermark",
    response_model=CopyPage,
    responses=LISTED | UNKNOWN | problem_responses(ErrorCode.INVALID_REQUEST),
)
def list_copies_of_watermark(
    request: Request,
    state: State,
    client: Admitted,
    job_id: str,
    limit: LimitQuery = 20,
    cursor: CursorQuery = None,
    accept: AcceptHeader = None,
) -> Any:
    """The copies of the job in the order in which they were asked for, with their states and links."""
    job = find_job(state, client, job_id)
    if NDJSON in (accept or "").lower():
        copies = list_copies(state.ledger.sessions, job).jobs
        lines = (CopyView.of(request, copy).model_dump_json() + "\n" for copy in copies)
        return Response("".join(lines), media_type=NDJSON)
    page = list_copies(state.ledger.sessions, job, limit, cursor)
    following = request.url.include_query_params(cursor=page.cursor)
    place = f"{following.path}?{following.query}" if page.cursor else None
    return CopyPage(items=[CopyView.of(request, copy) for copy in page.jobs], next=place)


@router.get(
    "/{job_id}/copies.zip",
    summary="Download all copies of a watermark",
    response_class=Response,
    responses=ARCHIVED
    | UNKNOWN
    | problem_responses(ServiceErrorCode.NOT_READY, ServiceErrorCode.JOB_EXPIRED, ServiceErrorCode.SERVICE_UNAVAILABLE),
)
async def download_copies_of_watermark(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """One ZIP with the models of all copies that have succeeded, once all have ended, and an index as NDJSON."""
    return await state.content.run(partial(_archive, request, state, client, job_id))


def _archive(request: Request, state: AppState, client: Client, job_id: str) -> Response:
    job = find_job(state, client, job_id)
    copies = list_copies(state.ledger.sessions, job).jobs
    if waiting := sum(copy.state in ACTIVE for copy in copies):
        raise MeshmarkError(
            ServiceErrorCode.NOT_READY,
            f"{waiting} of {len(copies)} copies have not ended.",
            f"Wait until all have; GET /v1/watermarks/{job_id}/copies lists them.",
        )
    entries = _entries(request, copies)
    if len(entries) == 1:
        raise MeshmarkError(
            ServiceErrorCode.NOT_FOUND,
            f"The watermark {job_id} has no copies whose files are there.",
            f"Make some: POST /v1/watermarks/{job_id}/copies.",
        )
    chunks = archived(state.artifacts, entries)
    try:
        first = next(chunks)  # read here, where an error can still become a response
    except FileNotFoundError:
        raise MeshmarkError(
            ServiceErrorCode.JOB_EXPIRED, "Copies were deleted meanwhile.", "Ask for the archive again."
        ) from None
    headers = {"Content-Disposition": disposition(f"{stem_of(job)}.copies.zip"), "Cache-Control": "private, no-store"}
    return StreamingResponse(state.content.each(chain([first], chunks)), headers=headers, media_type=ZIP)


def _entries(request: Request, copies: list[Job]) -> list[Entry]:
    """The models of copies, and last the index of all."""
    models: dict[str, Entry] = {}
    lines = []
    for copy in copies:
        name = None
        if model := copy.artifact(ArtifactKind.MODEL):
            name = f"{stem_of(copy)}.watermarked.glb"
            if name in models:  # names have not all letters that texts have
                name = f"{stem_of(copy)}-{copy.id}.watermarked.glb"
            models[name] = Entry(name, model)
        told = CopyView.of(request, copy).model_dump(mode="json", exclude={"links", "stage", "progress"})
        lines.append(json.dumps(told | {"file": name}, ensure_ascii=False) + "\n")
    return [*models.values(), Entry(INDEX, "".join(lines).encode())]
