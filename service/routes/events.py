"""Route of a job's event stream."""

from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse

from core.errors import ErrorCode
from service import access
from service.access import Admitted, GuardedRoute
from service.errors import ServiceErrorCode
from service.event_stream import EVENT_ID, event_stream, parse_last_event_id
from service.jobs import events
from service.jobs.ledger import ACTIVE
from service.jobs.models import EventType
from service.problems import problem_responses
from service.routes.watermarks import find_job
from service.state import State

router = APIRouter(prefix="/v1/watermarks", tags=["watermarks"], route_class=GuardedRoute)

EXAMPLE = (
    'id: 2\nevent: watermark.running\ndata: {"id": "6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11", "state": "running"}\n\n'
)
HEADERS = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}  # the second keeps nginx from buffering
EVENT: dict[str, Any] = {  # of OpenAPI 3.2
    "type": "object",
    "properties": {
        "id": {"type": "string", "pattern": EVENT_ID},
        "event": {"type": "string", "enum": [*EventType]},
        "data": {"type": "string", "contentMediaType": "application/json"},
    },
    "required": ["id", "event", "data"],
}
RESPONSES: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The events, until one ends the job: `id` is a number, `event` its type, `data` the job as JSON "
        "as it stood then.",
        "content": {"text/event-stream": {"itemSchema": EVENT, "example": EXAMPLE}},
    },
    204: {"description": "The job has ended and nothing is left to tell: a client need not come back."},
    **problem_responses(
        *access.REFUSALS,
        ServiceErrorCode.NOT_FOUND,
        ErrorCode.INVALID_REQUEST,
        ServiceErrorCode.TOO_MANY_STREAMS,
        ServiceErrorCode.SERVICE_UNAVAILABLE,
    ),
}
LastEventId = Annotated[
    str | None,
    Header(
        alias="Last-Event-ID",
        description="The last event that is known; the stream begins with the one after it.",
        json_schema_extra={"pattern": EVENT_ID},
    ),
]


async def _place(state: State, client: Admitted) -> AsyncIterator[None]:
    with state.streams.place(client.tenant):
        yield


@router.get("/{job_id}/events", response_class=Response, responses=RESPONSES, dependencies=[Depends(_place)])
async def stream_events(state: State, client: Admitted, job_id: str, last_event_id: LastEventId = None) -> Response:
    """What happens to the job, from its beginning on, as server-sent events."""
    after = parse_last_event_id(last_event_id)
    job = await run_in_threadpool(find_job, state, client, job_id)
    read = partial(events.read, state.ledger.sessions, job.id)
    after = min(after, job.event_count)
    if job.state not in ACTIVE and not await run_in_threadpool(read, after):
        return Response(status_code=204)
    return StreamingResponse(
        event_stream(read, after, state.streams.stopping), headers=HEADERS, media_type="text/event-stream"
    )
