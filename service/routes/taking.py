"""Form fields common to all requests that bring an asset, and the answer to them, for every kind of job."""

from typing import Annotated, Any

from fastapi import BackgroundTasks, Form, Header, Response

from service.routes.schemas import PriorityName
from service.state import AppState
from service.submission import Accepted

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


def answer_accepted(
    state: AppState, accepted: Accepted, place: str, response: Response, background: BackgroundTasks
) -> None:
    """Name the place of an accepted job in a response, and announce it once the response is sent."""
    response.headers["Location"] = place
    if accepted.replayed:
        response.headers["Idempotent-Replayed"] = "true"
    else:
        background.add_task(state.announcer.announce, accepted.job)  # the client does not wait for it
