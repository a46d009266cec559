"""Routes of conversions: send an asset of any format, fetch it as a plain GLB that browsers can show."""

from functools import partial
from pathlib import PurePath
from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, File, Request, Response, UploadFile, status

from core.errors import ErrorCode
from service import access
from service.access import Admitted, Client, GuardedRoute
from service.asset_route import AssetRoute
from service.delivery import disposition
from service.errors import ServiceErrorCode
from service.jobs.models import ArtifactKind, JobKind, Priority
from service.orders import order_from
from service.problems import problem_responses
from service.routes.conversion_schemas import ConversionView, view
from service.routes.stored import UNKNOWN, delete_job, download, find_job, send_file
from service.routes.taking import OF_FILES, PreferHeader, accepted, answer_accepted
from service.state import AppState, State
from service.submission import Accepted, submit
from service.waiting import Wait, preferred_wait

KIND = JobKind.CONVERSION
# Refusals of what a conversion does not take.
ELSEWHERE = (
    *(ServiceErrorCode.NOT_FOUND, ServiceErrorCode.UPLOAD_NOT_SENT, ServiceErrorCode.UPLOAD_MISMATCH),
    *(ServiceErrorCode.UPLOAD_EXPIRED, ServiceErrorCode.SOURCE_URL_DISABLED, ServiceErrorCode.ADDRESS_REFUSED),
    *(ServiceErrorCode.INVALID_METADATA, ServiceErrorCode.NO_WEBHOOK_SECRET, ErrorCode.INVALID_PARAMETERS),
    *(ServiceErrorCode.IDEMPOTENCY_KEY_IN_USE, ServiceErrorCode.IDEMPOTENCY_KEY_REUSED),
)
OF_ASSETS = tuple(code for code in OF_FILES if code not in ELSEWHERE)
PLACE: dict[str, Any] = {"prefix": "/v1/conversions", "tags": ["conversions"]}

router = APIRouter(**PLACE, route_class=GuardedRoute)
sending = APIRouter(**PLACE, route_class=AssetRoute)

AssetPart = Annotated[
    UploadFile,
    File(description="The asset: GLB, glTF, OBJ, STL, PLY, OFF, 3MF or DAE; with its other files as a ZIP."),
]


@sending.post(
    "",
    summary="Convert an asset into a plain GLB",
    status_code=status.HTTP_202_ACCEPTED,
    responses=accepted(ConversionView) | problem_responses(*access.REFUSALS, *OF_ASSETS),
)
async def create_conversion(
    request: Request,
    response: Response,
    background: BackgroundTasks,
    state: State,
    client: Admitted,
    file: AssetPart,
    prefer: PreferHeader = None,
) -> ConversionView:
    """Accept an asset to be shown: its geometry decoded, its textures as they are, KTX2 as PNG. It goes before the
    tenant's other waiting jobs, and nothing of it is kept for longer than an hour."""

    def accept() -> Accepted:
        return submit(state, order_from(state, client.tenant, None, {}, file=file, priority=Priority.HIGH))

    taken = await state.intake.run(client.tenant, accept)
    created = view(request, taken.job)
    answer_accepted(state, taken, created.links.self, response, background)
    request.state.wait = Wait(taken.job, preferred_wait(prefer), partial(view, request))
    return created


@router.get("/{job_id}", summary="Read a conversion", responses=UNKNOWN)
def read_conversion(request: Request, state: State, client: Admitted, job_id: str) -> ConversionView:
    """Where the conversion stands."""
    return view(request, find_job(state, client, job_id, KIND))


@router.delete(
    "/{job_id}", summary="Cancel or delete a conversion", status_code=status.HTTP_204_NO_CONTENT, responses=UNKNOWN
)
async def delete_conversion(state: State, client: Admitted, job_id: str) -> None:
    """Cancel the conversion if it has not ended, and delete the file and its result."""
    await state.deletions.run(partial(_delete, state, client, job_id))


def _delete(state: AppState, client: Client, job_id: str) -> None:
    delete_job(state, client, find_job(state, client, job_id, KIND))


MODEL = download(ArtifactKind.MODEL, {"type": "string", "format": "binary"}, "model/gltf-binary")


@router.head(
    "/{job_id}/model",
    name="head_converted_model",
    summary="Download the plain GLB of a conversion (headers only)",
    **MODEL,
)
@router.get("/{job_id}/model", summary="Download the plain GLB of a conversion", **MODEL)
async def read_converted_model(request: Request, state: State, client: Admitted, job_id: str) -> Response:
    """The asset as a GLB without compression and KTX2 textures, complete in itself."""
    return await state.content.run(partial(_model, request, state, client, job_id))


def _model(request: Request, state: AppState, client: Client, job_id: str) -> Response:
    job = find_job(state, client, job_id, KIND)
    name = disposition(PurePath(job.filename).stem + ".plain.glb")
    headers = {"Content-Type": "model/gltf-binary", "Content-Disposition": name}
    return send_file(request, state, job, ArtifactKind.MODEL, headers)
