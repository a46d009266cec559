"""Lists of jobs, for the routes of every kind of job."""

from typing import Annotated

from fastapi import Query, Request

from core.errors import ErrorCode
from service import access
from service.access import Client
from service.errors import ServiceErrorCode
from service.jobs.listing import Filters, list_jobs
from service.jobs.models import Job, JobState
from service.metadata import PAIR
from service.problems import problem_responses
from service.routes.schemas import Moment
from service.state import AppState

LISTING = problem_responses(
    *access.REFUSALS, ErrorCode.INVALID_REQUEST, ServiceErrorCode.INVALID_METADATA, ServiceErrorCode.SERVICE_UNAVAILABLE
)

StateQuery = Annotated[JobState | None, Query(alias="state", description="Only jobs in this state.")]
CreatedAfterQuery = Annotated[Moment | None, Query(description="Only jobs sent after this moment.")]
CreatedBeforeQuery = Annotated[Moment | None, Query(description="Only jobs sent before this moment.")]
MetadataQuery = Annotated[
    str | None,
    Query(
        description="Only jobs with this in their metadata, written `name:value`.",
        examples=["order:4711"],
        json_schema_extra={"pattern": PAIR},
    ),
]
LimitQuery = Annotated[int, Query(ge=1, le=100, description="Most jobs to list.")]
CursorQuery = Annotated[str | None, Query(max_length=200, description="As `next` has it.")]


def page_of(
    request: Request, state: AppState, client: Client, filters: Filters, limit: int, cursor: str | None
) -> tuple[list[Job], str | None]:
    """Some of a client's jobs, and where the list goes on.

    Raises:
        MeshmarkError: ``invalid_request``, the cursor is not one.
    """
    page = list_jobs(state.ledger.sessions, client.tenant, filters, limit, cursor)
    following = request.url.include_query_params(cursor=page.cursor)
    return page.jobs, f"{following.path}?{following.query}" if page.cursor else None
