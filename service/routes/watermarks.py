"""Routes of watermark jobs: send an asset, follow its job, fetch its results, delete it."""

from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, File, Form, Query, Request, Response, UploadFile, status

from core.errors import ErrorCode
from core.parameters import parse_parameters
from service import access, exports
from service.access import Admitted, Client, GuardedRoute
from service.asset_route import AssetRoute
from service.copies import check_copies, parse_copies, stem_of
from service.delivery import disposition
from service.idempotency_key import parse_idempotency_key
from service.jobs.listing import Filters
from service.jobs.models import ArtifactKind, Job, Priority
from service.metadata import parse_metadata, parse_pair
from service.orders import order_from
from service.problems import problem_responses
from service.routes.explanation_example import EXPLANATION
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
from service.routes.plan_example import PLAN
from service.routes.schemas import JobPage, JobView, view
from service.routes.stored import UNKNOWN, delete_job, download, find_job, send_file
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
from service.state import AppState, State
from service.submission import Accepted, submit
from service.waiting import Wait, preferred_wait

router = APIRouter(prefix="/v1/watermarks", tags=["watermarks"], route_class=GuardedRoute)
sending = APIRouter(prefix="/v1/watermarks", tags=["watermarks"], route_class=AssetRoute)

MEDIA_TYPES = {
    ArtifactKind.MODEL: ["model/gltf-binary"],
    ArtifactKind.PREVIEW_MODEL: ["model/gltf-binary"],
    ArtifactKind.EXPORT: [kind.media_type for kind in exports.KINDS.values()],
    ArtifactKind.PLAN: ["application/json"],
    ArtifactKind.REPORT: ["application/json"],
    ArtifactKind.PREVIEW: ["image/png"],
    ArtifactKind.TURNTABLE: ["image/webp"],
    ArtifactKind.POSTER: ["image/webp"],
    ArtifactKind.EXPLANATION: ["application/json"],
    ArtifactKind.LAYERS: ["model/gltf-binary"],
    ArtifactKind.CREDENTIALS: ["application/c2pa"],
    ArtifactKind.PREVIEW_MANIFEST: ["application/c2pa"],
}
CONTENT: dict[ArtifactKind, dict[str, Any]] = {
    ArtifactKind.MODEL: {"type": "string", "format": "binary"},
    ArtifactKind.PREVIEW_MODEL: {"type": "string", "format": "binary"},
    ArtifactKind.EXPORT: {"type": "string", "format": "binary"},
    ArtifactKind.PLAN: {
        "type": "object",
        "description": "`meshmark.plan/1`, as the manual's page on copies describes it.",
        "examples": [PLAN],
    },
    ArtifactKind.REPORT: {
        "$ref": "#/components/schemas/Report",
        "description": "`meshmark.report/1`, as the manual's page on the report describes it.",
    },
    ArtifactKind.PREVIEW: {"type": "string", "format": "binary"},
    ArtifactKind.TURNTABLE: {"type": "string", "format": "binary"},
    ArtifactKind.POSTER: {"type": "string", "format": "binary"},
    ArtifactKind.EXPLANATION: {
        "type": "object",
        "description": "`meshmark.explanation/1`, as the manual's page on the command line describes it.",
        "examples": [EXPLANATION],
    },
    ArtifactKind.LAYERS: {"type": "string", "format": "binary"},
    ArtifactKind.CREDENTIALS: {"type": "string", "format": "binary"},
    ArtifactKind.PREVIEW_MANIFEST: {"type": "string", "format": "binary"},
}
SUFFIXES = {
    ArtifactKind.MODEL: ".glb",
    ArtifactKind.PREVIEW_MODEL: ".preview.glb",
    ArtifactKind.PLAN: ".plan.json",
    ArtifactKind.REPORT: ".report.json",
    ArtifactKind.PREVIEW: ".png",
    ArtifactKind.TURNTABLE: ".turntable.webp",
    ArtifactKind.POSTER: ".poster.webp",
    ArtifactKind.EXPLANATION: ".explanation.json",
    ArtifactKind.LAYERS: ".explanation.glb",
    ArtifactKind.CREDENTIALS: ".c2pa",
    ArtifactKind.PREVIEW_MANIFEST: ".preview.c2pa",
}
# The manifest beside a result.
BESIDE = {
    ArtifactKind.MODEL: ArtifactKind.CREDENTIALS,
    ArtifactKind.PREVIEW_MODEL: ArtifactKind.PREVIEW_MANIFEST,
}

REFUSALS = problem_responses(
    *access.REFUSALS,
    *OF_FILES,
    ErrorCode.EMPTY_TEXT,
    ErrorCode.MISSING_GLYPHS,
    ErrorCode.INVALID_FONT,
    ErrorCode.INVALID_LOGO,
)

AssetPart = Annotated[
    UploadFile | None,
    File(description="The asset: GLB, glTF, OBJ, STL, PLY, OFF, 3MF or DAE; with its other files as a ZIP."),
]
FontPart = Annotated[UploadFile | None, File(description="A TrueType or OpenType font for the text.")]
LogoPart = Annotated[UploadFile | None, File(description="A logo: an SVG, alone or beside the text.")]
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
CopiesField = Annotated[
    str | None,
    Form(
        description="Copies of the asset with other texts at the same places, 1 to 1,000, as JSON. Each is a job of "
        "its own, which waits for this one: see GET /v1/watermarks/{job_id}/copies.",
        examples=['[{"text": "ORDER-4711", "metadata": {"customer": "17"}}, {"text": "ORDER-4712"}]'],
        json_schema_extra={
            "contentMediaType": "application/json",
            "contentSchema": {"type": "array", "maxItems": 1000, "items": {"$ref": "#/components/schemas/Copy"}},
        },
    ),
]
CacheQuery = Annotated[
    bool,
    Query(
        description="Whether results will do that exist already: where you had the same asset watermarked with the "
        "same parameters, font and logo, and still have the results, the new job has succeeded at once."
    ),
]


@sending.post(
    "", summary="Watermark an asset", status_code=status.HTTP_202_ACCEPTED, responses=accepted(JobView) | REFUSALS
)
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
    prefer: PreferHeader = None,
    copies: CopiesField = None,
    cache: CacheQuery = True,
) -> JobView:
    """Accept an asset for watermarking. What can be seen to be wrong at once is refused at once."""

    def accept() -> Accepted:
        parameters = parse_parameters(params)
        wanted = [] if copies is None else parse_copies(copies)
        checked = check_copies(wanted, parameters, logo=logo is not None, font=font is not None) if wanted else ()
        order = order_from(
            state,
            client.tenant,
            parameters,
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
            copies=checked,
        )
        return submit(state, order)

    taken = await state.intake.run(client.tenant, accept)
    created = view(request, taken.job)
    answer_accepted(state, taken, created.links.self, response, background)
    request.state.wait = Wait(taken.job, preferred_wait(prefer), partial(view, request))
    return created


@router.get("", summary="List watermark jobs", responses=LISTING)
def list_watermarks(
    request: Request,
    state: State,
    client: Admitted,
    job_state: StateQuery = None,
    created_after: CreatedAfterQuery = None,
    created_before: CreatedBeforeQuery = None,
    metadata: MetadataQuery = None,
    limit: LimitQuery = 20,
    cursor: CursorQuery = None,
) -> JobPage:
    """Your jobs, newest first."""
    pair = None if metadata is None else parse_pair(metadata)
    filters = Filters(job_state, created_after, created_before, pair)
    jobs, following = page_of(request, state, client, filters, limit, cursor)
    return JobPage(items=[view(request, job) for job in jobs], next=following)


@router.get("/{job_id}", summary="Read a watermark job", responses=UNKNOWN)
def read_watermark(request: Request, state: State, client: Admitted, job_id: str) -> JobView:
    """Where the job stands."""
    return view(request, find_job(state, client, job_id))


@router.delete(
    "/{job_id}", summary="Cancel or delete a watermark job", status_code=status.HTTP_204_NO_CONTENT, responses=UNKNOWN
)
async def delete_watermark(state: State, client: Admitted, job_id: str) -> None:
    """Cancel the job if it has not ended, and delete the asset, everything made from it, and what was said about it."""
    await state.deletions.run(partial(_delete, state, client, job_id))


def _delete(state: AppState, client: Client, job_id: str) -> None:
    delete_job(state, client, find_job(state, client, job_id))


Endpoint = Callable[[Request, State, Admitted, str], Awaitable[Response]]


def _offer(kind: ArtifactKind, title: str) -> Callable[[Endpoint], Endpoint]:
    """Decorator that adds the routes GET and HEAD of a result of a job."""
    path = f"/{{job_id}}/{kind}"

    def options() -> dict[str, Any]:  # each route's own: the document's HEAD has no content
        return download(kind, CONTENT[kind], *MEDIA_TYPES[kind])

    def add(read: Endpoint) -> Endpoint:
        get = router.get(path, summary=f"Download {title}", **options())(read)
        router.head(path, name=f"head_{kind}", summary=f"Download {title} (headers only)", **options())(read)
        return get

    return add


@_offer(ArtifactKind.MODEL, "the watermarked model")
async def read_model(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The watermarked GLB; there from stage `evaluating` on."""
    return await _deliver(request, state, client, job_id, ArtifactKind.MODEL)


@_offer(ArtifactKind.PREVIEW_MODEL, "the preview model")
async def read_preview_model(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """A light GLB for public display; where `preview_model` asked for one beside the model and marks fit on it."""
    return await _deliver(request, state, client, job_id, ArtifactKind.PREVIEW_MODEL)


@_offer(ArtifactKind.EXPORT, "the model in another format")
async def read_export(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The watermarked model as STL, PLY, 3MF, or a ZIP of an OBJ with its materials; where `format` asked for it."""
    return await _deliver(request, state, client, job_id, ArtifactKind.EXPORT)


@_offer(ArtifactKind.PLAN, "the plan")
async def read_plan(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The places of the marks, which copies take; not of a copy."""
    return await _deliver(request, state, client, job_id, ArtifactKind.PLAN)


@_offer(ArtifactKind.REPORT, "the report")
async def read_report(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """Where the watermarks are, and what they measure."""
    return await _deliver(request, state, client, job_id, ArtifactKind.REPORT)


@_offer(ArtifactKind.PREVIEW, "the preview")
async def read_preview(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """Pictures of the watermarked asset from eight sides, as one PNG."""
    return await _deliver(request, state, client, job_id, ArtifactKind.PREVIEW)


@_offer(ArtifactKind.TURNTABLE, "the turntable")
async def read_turntable(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The watermarked asset as it turns once, an animated WebP; where `turntable` asked for it."""
    return await _deliver(request, state, client, job_id, ArtifactKind.TURNTABLE)


@_offer(ArtifactKind.POSTER, "the turntable's poster")
async def read_poster(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The first frame of the turntable, a WebP; where `turntable` asked for it."""
    return await _deliver(request, state, client, job_id, ArtifactKind.POSTER)


@_offer(ArtifactKind.EXPLANATION, "the explanation")
async def read_explanation(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """Why marks stand where they stand: boxes by step, and what each mark adds and costs; where `explain` asked."""
    return await _deliver(request, state, client, job_id, ArtifactKind.EXPLANATION)


@_offer(ArtifactKind.LAYERS, "the explanation's model")
async def read_layers(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """GLB of the asset in grey clay with a node for the boxes of each step; where `explain` asked for it."""
    return await _deliver(request, state, client, job_id, ArtifactKind.LAYERS)


@_offer(ArtifactKind.CREDENTIALS, "the Content Credentials")
async def read_credentials(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The model's Content Credentials, a C2PA manifest store beside it; where the service signs its results."""
    return await _deliver(request, state, client, job_id, ArtifactKind.CREDENTIALS)


@_offer(ArtifactKind.PREVIEW_MANIFEST, "the preview model's Content Credentials")
async def read_preview_manifest(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The manifest store of the preview model, as `credentials` is the model's; where there is one beside the model."""
    return await _deliver(request, state, client, job_id, ArtifactKind.PREVIEW_MANIFEST)


async def _deliver(request: Request, state: AppState, client: Client, job_id: str, kind: ArtifactKind) -> Response:
    return await state.content.run(partial(_delivery, request, state, client, job_id, kind))


def _delivery(request: Request, state: AppState, client: Client, job_id: str, kind: ArtifactKind) -> Response:
    job = find_job(state, client, job_id)
    if kind is ArtifactKind.EXPORT:
        suffix, media_type = _kind_of_export(state, job)
    else:
        suffix, [media_type] = SUFFIXES[kind], MEDIA_TYPES[kind]
    name = stem_of(job) + ".watermarked" + suffix
    headers = {"Content-Type": media_type, "Content-Disposition": disposition(name)}
    response = send_file(request, state, job, kind, headers)
    if (beside := BESIDE.get(kind)) and job.artifact(beside):
        place = request.app.url_path_for(f"read_{beside}", job_id=job_id)
        response.headers["Link"] = f'<{place}>; rel="c2pa-manifest"'  # C2PA 2.2, section 15.5.3.2
    return response


def _kind_of_export(state: AppState, job: Job) -> exports.Kind:
    """Ending and media type of a job's export; those of any file where there is none."""
    head = b""
    if artifact := job.artifact(ArtifactKind.EXPORT):
        with suppress(FileNotFoundError):  # deleted since the ledger was read, as the answer will say
            head = b"".join(state.artifacts.read(artifact.sha256, 0, min(exports.HEAD, artifact.size)))
    return exports.kind_of(head)
