"""Request and response models of the webhook routes."""

from datetime import datetime
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from core.validation import StrictModel
from service.jobs.models import DeliveryState, DisabledReason, EventType, WebhookAttempt, WebhookDelivery
from service.jobs.models import WebhookEndpoint as Row
from service.webhooks.payload import Message

Event = Literal[
    "watermark.succeeded",
    "watermark.failed",
    "watermark.canceled",
    "watermark.expired",
    "verification.succeeded",
    "verification.failed",
    "verification.canceled",
    "verification.expired",
]
Url = Annotated[str, Field(max_length=2048, examples=["https://shop.example/hooks/meshmark"])]
Events = Annotated[list[Event], Field(min_length=1, max_length=8, description="Of what to send webhooks.")]
Secret = Annotated[
    str,
    Field(
        max_length=128,
        description="`whsec_` and the base64 of 24 to 64 bytes; null or left out: one is made.",
        examples=["whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSwMfKQ9r8GKYo="],
    ),
]
BY_DEFAULT: list[Event] = ["watermark.succeeded", "watermark.failed", "watermark.canceled", "watermark.expired"]

ENDPOINT: JsonDict = {
    "id": "0d2b1a7c-53a5-4f6e-9f39-6f1c2f0e9d11",
    "url": "https://shop.example/hooks/meshmark",
    "events": ["watermark.failed", "watermark.succeeded"],
    "disabled": False,
    "disabled_reason": None,
    "former_secret_until": None,
    "created_at": "2026-01-31T12:00:00.000000Z",
}
DELIVERY: JsonDict = {
    "id": "5d8f4c1f-9a0e-4d57-8c39-4c8a9d520a11",
    "webhook_id": "msg_6f1c2f0e53a54f6e9f390d2b1a7c9d11_9",
    "type": "watermark.succeeded",
    "job_id": "6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11",
    "url": None,
    "state": "delivered",
    "created_at": "2026-01-31T12:00:09.000000Z",
    "next_attempt_at": None,
    "attempts": [
        {
            "number": 1,
            "started_at": "2026-01-31T12:00:09.100000Z",
            "status": 204,
            "error": None,
            "snippet": "",
            "seconds": 0.21,
        }
    ],
}


class NewEndpoint(StrictModel):
    """A webhook endpoint to be made."""

    url: Annotated[
        Url | None,
        Field(description="Null: it is for the webhooks that jobs name themselves; you can have one of these."),
    ]
    events: Events = BY_DEFAULT
    secret: Secret | None = None


class EndpointChange(StrictModel):
    """What to change of a webhook endpoint; what is null or left out stays as it is."""

    url: Url | None = None
    events: Events | None = None
    disabled: Annotated[bool | None, Field(description="A disabled endpoint is sent nothing.")] = None


class NewSecret(StrictModel):
    """Another secret of a webhook endpoint."""

    secret: Secret | None = None


class WebhookEndpoint(BaseModel):
    """Where webhooks are sent."""

    model_config = ConfigDict(json_schema_extra={"examples": [ENDPOINT]})

    id: str
    url: Annotated[str | None, Field(description="Null: of the webhooks that jobs name themselves.")]
    events: list[EventType]
    disabled: bool
    disabled_reason: Annotated[
        DisabledReason | None, Field(description="`requested`, or `gone`: it answered a webhook with 410.")
    ]
    former_secret_until: Annotated[
        datetime | None, Field(description="Until when messages are signed with the former secret too.")
    ]
    created_at: datetime

    @classmethod
    def of(cls, row: Row, **more: str) -> Self:
        """Response model of an endpoint."""
        return cls(
            id=row.id,
            url=row.url,
            events=[EventType(name) for name in row.events],
            disabled=row.disabled_reason is not None,
            disabled_reason=row.disabled_reason,
            former_secret_until=row.former_secret_until,
            created_at=row.created_at,
            **more,
        )


class WebhookEndpointWithSecret(WebhookEndpoint):
    """A webhook endpoint whose secret is new."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{**ENDPOINT, "secret": "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSwMfKQ9r8GKYo="}]}
    )

    secret: Annotated[str, Field(description="Shown this once.")]


class WebhookEndpoints(BaseModel):
    """All webhook endpoints there are, the oldest first."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"items": [ENDPOINT]}]})

    items: list[WebhookEndpoint]


class Attempt(BaseModel):
    """One attempt to deliver a webhook."""

    number: int
    started_at: datetime
    status: Annotated[int | None, Field(description="The HTTP status; null: there was no answer.")]
    error: Annotated[str | None, Field(description="What went wrong, if no answer came or it broke off.")]
    snippet: Annotated[str, Field(description="The beginning of the answer.")]
    seconds: float

    @classmethod
    def of(cls, row: WebhookAttempt) -> Self:
        """Response model of an attempt."""
        return cls(
            number=row.number,
            started_at=row.started_at,
            status=row.status,
            error=row.error,
            snippet=row.snippet,
            seconds=round(row.seconds, 3),
        )


class Delivery(BaseModel):
    """A webhook, and what came of it."""

    model_config = ConfigDict(json_schema_extra={"examples": [DELIVERY]})

    id: str
    webhook_id: Annotated[str, Field(description="The header `webhook-id` of the message, the same at each attempt.")]
    type: EventType
    job_id: str
    url: Annotated[str | None, Field(description="The job's own webhook; null: the endpoint's url.")]
    state: DeliveryState
    created_at: datetime
    next_attempt_at: Annotated[
        datetime | None, Field(description="When it is due; while it is sent: when it is sent again if nobody answers.")
    ]
    attempts: list[Attempt]

    @classmethod
    def of(cls, row: WebhookDelivery) -> Self:
        """Response model of a delivery."""
        return cls(
            id=row.id,
            webhook_id=Message.about(row.event).id,
            type=row.event.type,
            job_id=row.job_id,
            url=row.url,
            state=row.state,
            created_at=row.created_at,
            next_attempt_at=row.due_at,
            attempts=[Attempt.of(attempt) for attempt in row.log],
        )


class DeliveryPage(BaseModel):
    """Some of an endpoint's deliveries, newest first."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"items": [DELIVERY], "next": None}]})

    items: list[Delivery]
    next: Annotated[str | None, Field(description="Where the list goes on; null: this is its end.")]
