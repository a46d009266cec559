"""Event streams of jobs."""

from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Header, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse

from core.errors import ErrorCode
from service import access
from service.access import Admitted, Client, GuardedRoute
from service.errors import ServiceErrorCode
from service.event_stream import EVENT_ID, event_stream, parse_last_event_id
from service.jobs import events
from service.jobs.models import EventType, JobKind
from service.jobs.transitions import ACTIVE
from service.problems import problem_responses
from service.routes.stored import find_job
from service.state import AppState, State

router = APIRouter(prefix="/v1/watermarks", tags=["watermarks"], route_class=GuardedRoute)

HEADERS = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}  # the second keeps nginx from buffering


def responses(kind: JobKind) -> dict[int | str, dict[str, Any]]:
    """OpenAPI responses of the event streams of a kind of job."""
    types = ", ".join(f"`{name}`" for name in EventType if name.startswith(f"{kind}."))
    job = '{"id": "6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11", "state": "running"}'
    content = {"schema": {"type": "string"}, "example": f"id: 2\nevent: {kind}.running\ndata: {job}\n\n"}
    return {
        200: {
            "description": "The events, until one ends the job: `id` is a number, `event` its type, `data` the job as "
            f"JSON as it stood then. Types are {types}.",
            "content": {"text/event-stream": content},
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


def options(kind: JobKind) -> dict[str, Any]:
    """Options of a route of event streams."""
    return {"response_class": Response, "responses": responses(kind), "dependencies": [Depends(_place)]}


async def stream(
    state: AppState, client: Client, job_id: str, last_event_id: str | None, kind: JobKind = JobKind.WATERMARK
) -> Response:
    """Response with the events of a job of some kind.

    Raises:
        MeshmarkError: ``not_found``, ``invalid_request``.
    """
    after = parse_last_event_id(last_event_id)
    job = await run_in_threadpool(find_job, state, client, job_id, kind)
    read = partial(events.read, state.ledger.sessions, job.id)
    after = min(after, job.event_count)
    if job.state not in ACTIVE and not await run_in_threadpool(read, after):
        return Response(status_code=204)
    return StreamingResponse(
        event_stream(read, after, state.streams.stopping), headers=HEADERS, media_type="text/event-stream"
    )


@router.get("/{job_id}/events", summary="Follow a watermark job", **options(JobKind.WATERMARK))
async def stream_events(state: State, client: Admitted, job_id: str, last_event_id: LastEventId = None) -> Response:
    """What happens to the job, from its beginning on, as server-sent events."""
    return await stream(state, client, job_id, last_event_id)
