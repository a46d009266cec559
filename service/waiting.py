"""Clients that prefer to wait for the end of the job that they ask for (RFC 7240, `Prefer: wait`).

Such a client holds no thread and no connection to the ledger while it waits, and neither its upload's place nor its
files. It takes a place among the event streams, which look at the ledger as often.
"""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import structlog
from fastapi import Request, Response, status
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel
from sqlalchemy.exc import OperationalError
from starlette.background import BackgroundTask

from core.errors import MeshmarkError
from service.event_stream import POLL
from service.jobs.models import Job
from service.jobs.transitions import ACTIVE
from service.state import AppState, state_of

LONGEST = 55  # seconds: proxies give an answer up after a minute, as a rule

log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Wait:
    """Wait for the end of a job, for so many seconds at most; `view` makes the answer."""

    job: Job
    seconds: int
    view: Callable[[Job], BaseModel]


def preferred_wait(prefer: str | None) -> int:
    """Seconds that a client prefers to wait, of the header Prefer, LONGEST at most; 0 where it does not say so.

    What cannot be understood is ignored, as the RFC asks.
    """
    for preference in (prefer or "").split(","):
        name, _, value = preference.partition(";")[0].partition("=")
        seconds = value.strip().strip('"')
        if name.strip().lower() == "wait" and seconds.isascii() and seconds.isdigit():
            return min(int(seconds[:9]), LONGEST)
    return 0


async def answer_at_end(request: Request, response: Response) -> Response:
    """The answer to a request that made a job: at once, or with the ended job if the client prefers to wait.

    It is the response that was given, 202, where the job does not end in time, where the client has left, and where
    too many wait already.
    """
    wait = getattr(request.state, "wait", None)
    if not isinstance(wait, Wait) or not wait.seconds:
        return response
    state = state_of(request)
    try:
        with state.streams.place(wait.job.tenant_id):
            announcing = asyncio.ensure_future(_run(response.background))
            response.background = BackgroundTask(asyncio.wait_for, announcing, None)
            job = await _ended(request, state, wait)
    except MeshmarkError:  # there is no place
        return response
    response.headers["Preference-Applied"] = "wait"
    if job is None:
        return response
    headers = {name: value for name, value in response.headers.items() if name != "content-length"}
    return Response(wait.view(job).model_dump_json(), status.HTTP_200_OK, headers, background=response.background)


async def _run(background: BackgroundTask | None) -> None:
    if background is not None:
        await background()


async def _ended(request: Request, state: AppState, wait: Wait) -> Job | None:
    """Ended job; None where it has not ended in time, is forgotten, or nobody waits for it any more."""
    until, stopping = time.monotonic() + wait.seconds, state.streams.stopping
    while True:
        try:
            job = await run_in_threadpool(state.ledger.get, wait.job.id, wait.job.tenant_id)
        except OperationalError as error:  # it may answer before the wait is over
            log.warning("the job ledger does not answer", error=str(error.orig))
        else:
            if job is None or job.state not in ACTIVE:
                return job
        left = until - time.monotonic()
        if left <= 0 or stopping.is_set() or await request.is_disconnected():
            return None
        with suppress(TimeoutError):
            await asyncio.wait_for(stopping.wait(), min(POLL, left))
