"""Uploads: send an asset ahead, then name it in as many requests as you like."""

from datetime import datetime
from functools import partial
from typing import Annotated, Literal, Self

from fastapi import APIRouter, Request, status
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, ConfigDict, Field
from starlette.requests import ClientDisconnect

from core.errors import ErrorCode, MeshmarkError
from core.validation import StrictModel
from service import access
from service.access import Admitted, GuardedRoute
from service.asset_route import AssetRoute
from service.errors import ServiceErrorCode
from service.jobs import uploads
from service.jobs.artifacts import CHUNK, writing
from service.jobs.models import Upload
from service.problems import problem_responses
from service.state import State
from service.submission import plain_name

router = APIRouter(prefix="/v1/uploads", tags=["uploads"], route_class=GuardedRoute)
sending = APIRouter(prefix="/v1/uploads", tags=["uploads"], route_class=AssetRoute)

BEGINNING = problem_responses(
    *access.REFUSALS,
    ErrorCode.INVALID_REQUEST,
    ServiceErrorCode.UNSUPPORTED_MEDIA_TYPE,
    ServiceErrorCode.UPLOAD_TOO_LARGE,
    ServiceErrorCode.REQUEST_TIMEOUT,
    ServiceErrorCode.TOO_MANY_UPLOADS,
    ServiceErrorCode.QUOTA_EXCEEDED,
    ServiceErrorCode.SERVICE_UNAVAILABLE,
)
SENDING = problem_responses(
    *access.REFUSALS,
    ErrorCode.INVALID_REQUEST,
    ServiceErrorCode.NOT_FOUND,
    ServiceErrorCode.UPLOAD_TOO_LARGE,
    ServiceErrorCode.UPLOAD_MISMATCH,
    ServiceErrorCode.UPLOAD_EXPIRED,
    ServiceErrorCode.REQUEST_TIMEOUT,
    ServiceErrorCode.TOO_MANY_UPLOADS,
    ServiceErrorCode.SERVICE_UNAVAILABLE,
)
BODY = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}


class NewUpload(StrictModel):
    """What is going to be sent."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"filename": "lantern.glb", "size": 9563016}]})

    size: Annotated[int, Field(ge=0, strict=True, description="Bytes of the asset.")]
    sha256: Annotated[
        str | None, Field(pattern="^[0-9a-f]{64}$", description="Its SHA-256 in hexadecimal, where you know it.")
    ] = None
    filename: Annotated[str, Field(max_length=1000, description="What you call it.")] = "asset"


class UploadView(BaseModel):
    """Where to send an asset, and how to name it afterwards."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "id": "4c8a9d52-9a0e-4d57-8c39-5d8f4c1f0a11",
                    "method": "PUT",
                    "url": "/v1/uploads/4c8a9d52-9a0e-4d57-8c39-5d8f4c1f0a11",
                    "url_expires_at": "2026-02-01T12:00:00.000000Z",
                    "expires_at": "2026-02-01T12:00:00.000000Z",
                }
            ]
        }
    )

    id: Annotated[str, Field(description="Give it as `upload_id` to POST /v1/watermarks.")]
    method: Literal["PUT"] = "PUT"
    url: Annotated[
        str,
        Field(
            description="PUT the asset's bytes here. An absolute address leads to the bucket: send no API key there. "
            "A path is one of this service, used with your key like any other."
        ),
    ]
    url_expires_at: Annotated[datetime, Field(description="Until when the asset can be sent.")]
    expires_at: Annotated[datetime, Field(description="Until when the upload can be named.")]

    @classmethod
    def of(cls, upload: Upload, link: str | None, path: str) -> Self:
        """Response model of an upload: `link` leads to the bucket, if there is one, `path` to the service."""
        until = upload.created_at + uploads.LINK_LIFETIME if link else upload.expires_at
        return cls(id=upload.id, url=link or path, url_expires_at=until, expires_at=upload.expires_at)


@router.post("", summary="Begin an upload", status_code=status.HTTP_201_CREATED, responses=BEGINNING)
def create_upload(request: Request, state: State, client: Admitted, new: NewUpload) -> UploadView:
    """Begin an upload. It can be used for 24 hours, any number of times."""
    limit = state.settings.max_upload_bytes
    if new.size > limit:
        raise MeshmarkError(
            ServiceErrorCode.UPLOAD_TOO_LARGE,
            f"The asset is larger than the {limit:,} bytes accepted here.",
            "Send a smaller one, or ask the operator to raise the limit.",
        )
    most = state.settings.max_active_jobs
    name = plain_name(new.filename)
    upload = uploads.begin(
        state.ledger.sessions, client.tenant, name, new.size, new.sha256, most, state.settings.max_stored_bytes
    )
    link = state.artifacts.upload_link(upload.id, uploads.LINK_LIFETIME)
    return UploadView.of(upload, link, request.app.url_path_for("send_upload", upload_id=upload.id))


@sending.put(
    "/{upload_id}",
    summary="Send the asset of an upload",
    status_code=status.HTTP_204_NO_CONTENT,
    responses=SENDING,
    openapi_extra=BODY,
)
async def send_upload(request: Request, state: State, client: Admitted, upload_id: str) -> None:
    """Send the asset of an upload, as the body of the request; again, where it broke off."""
    upload = await run_in_threadpool(uploads.find, state.ledger.sessions, client.tenant, upload_id)
    with writing(), state.artifacts.spool() as body:
        received = 0
        try:
            async for chunk in request.stream():
                received += await run_in_threadpool(body.write, chunk)
                if received > upload.size:
                    break  # the excess is reported below
        except ClientDisconnect:
            raise MeshmarkError(
                ErrorCode.INVALID_REQUEST, "The upload broke off.", "Send the whole asset again."
            ) from None
        body.seek(0)
        chunks = iter(lambda: body.read(CHUNK), b"")
        await state.content.run(partial(uploads.receive, state.artifacts, upload, chunks))
