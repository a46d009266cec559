"""A job's events as a stream that a browser's EventSource reads (WHATWG HTML, "Server-sent events")."""

import asyncio
import json
import re
import time
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

import structlog
from fastapi.concurrency import run_in_threadpool
from fastapi.sse import KEEPALIVE_COMMENT, format_sse_event
from sqlalchemy.exc import OperationalError

from core.errors import ErrorCode, MeshmarkError
from service.errors import ServiceErrorCode
from service.in_flight import InFlight
from service.jobs.events import ENDINGS
from service.jobs.models import JobEvent

EVENT_ID = "^([0-9]{1,9})?$"  # the number of an event; empty: none
# Concurrent streams of one API process, and of a tenant there. Each polls the ledger twice a second: some six hundred
# keep a process busy.
STREAMS, STREAMS_PER_TENANT = 500, 100
POLL = 0.5  # seconds between two reads of the ledger
PING = 15.0  # seconds without an event after which a keep-alive comment is sent
LONGEST = 600.0  # seconds a stream stays open; a client that reconnects is authenticated again
RETRY = 1000  # milliseconds a client waits before it reconnects

log = structlog.get_logger(__name__)


class Streams:
    """Open event streams of one API process."""

    def __init__(self) -> None:
        self.stopping = asyncio.Event()
        self._open = InFlight()

    def stop(self) -> None:
        """End every stream at shutdown: its client reconnects to another process."""
        self.stopping.set()

    def count(self, tenant: str) -> int:
        """Number of a tenant's open streams."""
        return self._open.count(tenant)

    @contextmanager
    def place(self, tenant: str) -> Iterator[None]:
        """Count one more open stream of a tenant during the block.

        Raises:
            MeshmarkError: ``too_many_streams``; ``service_unavailable`` where all tenants together have too many.
        """
        if self._open.count(tenant) >= STREAMS_PER_TENANT:
            raise MeshmarkError(
                ServiceErrorCode.TOO_MANY_STREAMS,
                f"{STREAMS_PER_TENANT} event streams of yours are open, the most at a time.",
                "Close some, or ask for the jobs' states or their webhooks instead.",
            )
        if self._open.total() >= STREAMS:
            raise MeshmarkError(
                ServiceErrorCode.SERVICE_UNAVAILABLE,
                f"{STREAMS} event streams are open here, the most at a time.",
                "Try again in a few seconds, or ask for the jobs' states or their webhooks instead.",
            )
        with self._open.counted(tenant):
            yield


def parse_last_event_id(text: str | None) -> int:
    """Number of the last event that a client has seen; 0: none.

    Raises:
        MeshmarkError: ``invalid_request``.
    """
    if not text:
        return 0
    if not re.fullmatch(EVENT_ID, text):
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "The Last-Event-ID is not the id of an event.",
            "Send the id that the last event had, or leave out the header to begin anew.",
        )
    return int(text)


async def event_stream(
    read: Callable[[int], Sequence[JobEvent]], after: int, stopping: asyncio.Event
) -> AsyncIterator[bytes]:
    """Events after a number, recorded and to come, until the one that ends the job.

    Args:
        read: gives the events after a number; it may block, and runs in a thread.
        after: the number of the last event that is known.
        stopping: ends the stream.
    """
    began = silent_since = time.monotonic()
    yield format_sse_event(retry=RETRY)
    while not stopping.is_set() and time.monotonic() < began + LONGEST:
        events: Sequence[JobEvent] = ()
        try:
            events = await run_in_threadpool(read, after)
        except OperationalError as error:  # the stream stays open: later reads return the events of the outage
            log.warning("the job ledger does not answer", error=str(error.orig))
        for event in events:
            yield as_text(event)
            after = event.number
        if events and events[-1].type in ENDINGS:
            return
        if events:
            silent_since = time.monotonic()
        elif time.monotonic() > silent_since + PING:
            silent_since = time.monotonic()
            yield KEEPALIVE_COMMENT
        with suppress(TimeoutError):
            await asyncio.wait_for(stopping.wait(), POLL)


def as_text(event: JobEvent) -> bytes:
    """An event in the stream's format: its number as `id`, its type as `event`, the job in one line of `data`."""
    return format_sse_event(id=str(event.number), event=event.type, data_str=json.dumps(event.data, ensure_ascii=False))
