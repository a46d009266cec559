"""Batches: many jobs in one request."""

import json
from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, Request, status
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.exc import OperationalError

from core.errors import ErrorCode, MeshmarkError
from core.parameters import parse_parameters
from core.validation import StrictModel
from service import access
from service.access import Admitted, Client, GuardedRoute, take_request
from service.copies import check_copies, parse_copies
from service.errors import ServiceErrorCode
from service.idempotency_key import parse_idempotency_key
from service.intake import Verdicts
from service.jobs.models import Priority
from service.metadata import parse_metadata
from service.orders import order_from
from service.problems import Problem, ledger_unavailable, problem_of, problem_responses
from service.routes.schemas import EXAMPLE, JobView, PriorityName, view
from service.state import AppState, State
from service.submission import Accepted, submit

MOST = 100  # items of a batch

router = APIRouter(prefix="/v1/watermarks", tags=["watermarks"], route_class=GuardedRoute)

REFUSALS = problem_responses(
    *access.REFUSALS,
    ErrorCode.INVALID_REQUEST,
    ServiceErrorCode.UNSUPPORTED_MEDIA_TYPE,
    ServiceErrorCode.UPLOAD_TOO_LARGE,
    ServiceErrorCode.REQUEST_TIMEOUT,
    ServiceErrorCode.SERVICE_UNAVAILABLE,
)


class BatchItem(StrictModel):
    """One job to make: as in POST /v1/watermarks, with the asset sent ahead or at an address."""

    upload_id: Annotated[str | None, Field(description="The id of an upload, see POST /v1/uploads.")] = None
    source_url: Annotated[str | None, Field(description="Or the asset's https address, where that is allowed.")] = None
    parameters: Annotated[dict[str, Any], Field(description="What to emboss and how: a `Parameters` object.")]
    metadata: Annotated[dict[str, Any], Field(description="What you want to find the job by.")] = {}  # noqa: RUF012
    priority: Annotated[PriorityName, Field(description="Which of your waiting jobs goes first.")] = "normal"
    webhook: Annotated[
        str | None, Field(description="Where to send a webhook when the job ends, as in POST /v1/watermarks.")
    ] = None
    idempotency_key: Annotated[
        str | None, Field(description="As the header Idempotency-Key of POST /v1/watermarks.")
    ] = None
    cache: Annotated[bool, Field(strict=True, description="Whether results will do that exist already.")] = True
    copies: Annotated[
        list[dict[str, Any]], Field(description="Copies of it, as in POST /v1/watermarks: each a `Copy` object.")
    ] = []  # noqa: RUF012


class Batch(StrictModel):
    """Jobs to make."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "items": [
                        {
                            "upload_id": "4c8a9d52-9a0e-4d57-8c39-5d8f4c1f0a11",
                            "parameters": {"text": "SAMPLE"},
                            "metadata": {"order": "4711"},
                            "idempotency_key": "8e03978e-40d5-43dd-bc93-6894a57f9324",
                        }
                    ]
                }
            ]
        },
    )

    items: Annotated[list[BatchItem], Field(min_length=1, max_length=MOST)]


class BatchResult(BaseModel):
    """What came of one item."""

    status: Annotated[int, Field(description="The status that POST /v1/watermarks would have answered with.")]
    replayed: Annotated[
        bool, Field(description="Whether an earlier item or request with the same idempotency key made the job.")
    ] = False
    job: JobView | None = None
    problem: Annotated[Problem | None, Field(description="Why there is no job.")] = None


class BatchResults(BaseModel):
    """What came of each item, in their order."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"items": [{"status": 202, "job": EXAMPLE}]}]})

    items: list[BatchResult]


@router.post("/batch", summary="Watermark many assets", status_code=status.HTTP_207_MULTI_STATUS, responses=REFUSALS)
async def create_watermarks(
    request: Request, background: BackgroundTasks, state: State, client: Admitted, batch: Batch
) -> BatchResults:
    """Make up to 100 jobs. Each item is accepted or refused by itself, and counts as a request of its own."""

    def accept() -> list[BatchResult]:
        known: Verdicts = {}
        return [
            _result(request, background, state, client, item, known, paid=number == 0)
            for number, item in enumerate(batch.items)
        ]

    return BatchResults(items=await state.intake.run(client.tenant, accept))


def _result(
    request: Request,
    background: BackgroundTasks,
    state: AppState,
    client: Client,
    item: BatchItem,
    known: Verdicts,
    paid: bool,
) -> BatchResult:
    """Result of an item; where `paid`, the request itself has already been counted for it."""
    try:
        if not paid:
            take_request(state, client)
        job, replayed, started = _submit(state, client, item, known)
    except OperationalError:
        return _refused(ledger_unavailable())
    except MeshmarkError as error:
        return _refused(error)
    if not replayed:
        for each in (job, *started):
            background.add_task(state.announcer.announce, each)
    return BatchResult(status=status.HTTP_202_ACCEPTED, replayed=replayed, job=view(request, job))


def _submit(state: AppState, client: Client, item: BatchItem, known: Verdicts) -> Accepted:
    parameters = parse_parameters(item.parameters)
    copies = parse_copies(json.dumps(item.copies)) if item.copies else []
    order = order_from(
        state,
        client.tenant,
        parameters,
        parse_metadata(item.metadata),
        source_url=item.source_url,
        upload_id=item.upload_id,
        webhook=item.webhook,
        priority=Priority[item.priority.upper()],
        key=None if item.idempotency_key is None else parse_idempotency_key(item.idempotency_key),
        cache=item.cache,
        copies=check_copies(copies, parameters, logo=False, font=False) if copies else (),
    )
    return submit(state, order, known)


def _refused(error: MeshmarkError) -> BatchResult:
    problem = problem_of(error)
    return BatchResult(status=problem.status, problem=problem)
