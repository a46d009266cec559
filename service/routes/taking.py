"""Parts of every form that brings an asset, and the answer that takes it, for the routes of every kind of job."""

from typing import Annotated, Any

from fastapi import BackgroundTasks, Form, Header, Response
from pydantic import BaseModel

from core.errors import Code, ErrorCode
from service.errors import ServiceErrorCode
from service.routes.schemas import PriorityName
from service.state import AppState
from service.submission import Accepted
from service.waiting import LONGEST

# Refusals of a request that brings a file, whatever is to be done with it.
OF_FILES: tuple[Code, ...] = (
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
HEADERS = {
    "Location": {"description": "The job's own address.", "schema": {"type": "string"}},
    "Idempotent-Replayed": {
        "description": "`true` where an earlier request made the job.",
        "schema": {"type": "string", "enum": ["true"]},
    },
    "Preference-Applied": {
        "description": "`wait` where the answer was kept back because of `Prefer: wait`.",
        "schema": {"type": "string", "enum": ["wait"]},
    },
}

SourceUrlField = Annotated[
    str | None,
    Form(
        description="In place of `file`: the https address of the asset, where the service is set up so. It is "
        "fetched by a worker; redirects are not followed. The address is not shown again to anybody.",
        examples=["https://files.example/lantern.glb?signature=..."],
    ),
]
UploadIdField = Annotated[
    str | None,
    Form(
        description="In place of `file`: the id of an upload, see POST /v1/uploads.",
        examples=["4c8a9d52-9a0e-4d57-8c39-5d8f4c1f0a11"],
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


PreferHeader = Annotated[
    str | None,
    Header(
        alias="Prefer",
        description=f"`wait=N` (RFC 7240) keeps the answer back until the job has ended, for N seconds at most, or for "
        f"{LONGEST}: it is 200 with the ended job then, and else 202 as without.",
        examples=["wait=30"],
    ),
]


def accepted(model: type[BaseModel]) -> dict[int | str, dict[str, Any]]:
    """OpenAPI responses of a route that makes a job of this model."""
    return {
        200: {
            "description": "The job has ended; only with `Prefer: wait`.",
            "model": model,
            "headers": HEADERS,
        },
        202: {
            "description": "The new job, or that of an earlier request with the same `Idempotency-Key`.",
            "headers": HEADERS,
        },
    }


def answer_accepted(
    state: AppState, accepted: Accepted, place: str, response: Response, background: BackgroundTasks
) -> None:
    """Name the place of an accepted job in a response, and announce it once the response is sent."""
    response.headers["Location"] = place
    if accepted.replayed:
        response.headers["Idempotent-Replayed"] = "true"
    else:
        for job in (accepted.job, *accepted.started):
            background.add_task(state.announcer.announce, job)  # the client does not wait for it
