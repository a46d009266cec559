"""Delivery attempt of a webhook, and its verdict on the next one."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from enum import StrEnum

from core.errors import MeshmarkError
from service.outbound.client import OutboundClient
from service.outbound.errors import Unreachable
from service.outbound.policy import Timeouts
from service.webhooks.payload import Message
from service.webhooks.schedule import next_attempt, parse_retry_after
from service.webhooks.signing import sign

TIMEOUTS = Timeouts(connect=5.0, silence=20.0, total=20.0)  # the specification asks for 15 to 30 seconds
SNIPPET_BYTES = 1024  # of an answer's body that are kept
UNPRINTABLE = "\N{REPLACEMENT CHARACTER}"
GONE = 410  # status of an endpoint that is to be disabled
THROTTLED = (429, 503)  # statuses whose Retry-After counts


class Result(StrEnum):
    """Verdict on an attempt, for the message and its endpoint."""

    DELIVERED = "delivered"
    RETRY = "retry"
    EXHAUSTED = "exhausted"  # that was the last attempt
    ENDPOINT_GONE = "endpoint_gone"  # send nothing there any more


@dataclass(frozen=True)
class Outcome:
    """Outcome of an attempt.

    Attributes:
        result: the verdict.
        status: the HTTP status, if there was an answer.
        error: the error of the exchange, if there was one.
        snippet: the beginning of the answer's body, at most 1 KiB, without control characters.
        seconds: duration of the attempt.
        retry_at: time of the next attempt, with `Result.RETRY` only.
    """

    result: Result
    status: int | None
    error: str | None
    snippet: str
    seconds: float
    retry_at: datetime | None


def deliver(
    client: OutboundClient, url: str, secrets: Sequence[str], message: Message, attempt: int, now: datetime, draw: float
) -> Outcome:
    """Send a message to an endpoint once.

    Errors of the endpoint are in the outcome, not raised.

    Args:
        client: a client with the time-outs of this module.
        url: the endpoint.
        secrets: its secrets, the newest first.
        message: the message.
        attempt: number of this attempt, from 1.
        now: the time, aware.
        draw: a random number, 0 to 1, for the jitter.

    Raises:
        MeshmarkError: ``invalid_secret``.
    """
    headers = {"Content-Type": "application/json", **sign(secrets, message.id, now, message.body)}
    status: int | None = None
    error: str | None = None
    retry_after: timedelta | None = None
    received = bytearray()
    started = time.monotonic()
    try:
        with client.send("POST", url, headers, message.body) as answer:
            status = answer.status
            if status in THROTTLED:
                retry_after = parse_retry_after(answer.headers.get("retry-after"), now)
            for chunk in answer.body:
                received += chunk
                if len(received) >= SNIPPET_BYTES:
                    break
    except MeshmarkError as refused:
        error = str(refused)
    except Unreachable as trouble:
        error = f"The endpoint could not be used: {trouble}."
    seconds = time.monotonic() - started
    result, retry_at = _verdict(status, attempt, now + timedelta(seconds=seconds), draw, retry_after)
    return Outcome(result, status, error, _printable(bytes(received[:SNIPPET_BYTES])), seconds, retry_at)


def not_made(attempt: int, now: datetime, draw: float) -> Outcome:
    """Outcome of an attempt that failed by a fault of ours: it counts, so that it is not repeated for ever."""
    result, retry_at = _verdict(None, attempt, now, draw, None)
    return Outcome(result, None, "The service could not make this attempt.", "", 0.0, retry_at)


def _verdict(
    status: int | None, attempt: int, at: datetime, draw: float, retry_after: timedelta | None
) -> tuple[Result, datetime | None]:
    if status is not None and 200 <= status < 300:
        return Result.DELIVERED, None
    if status == GONE:
        return Result.ENDPOINT_GONE, None
    retry_at = next_attempt(attempt, at, draw, retry_after)
    return (Result.RETRY, retry_at) if retry_at else (Result.EXHAUSTED, None)


def _printable(received: bytes) -> str:
    """Decode bytes of unknown origin to text that any log and any database takes."""
    text = received.decode(errors="replace")
    return "".join(letter if letter.isprintable() or letter in "\n\t" else UNPRINTABLE for letter in text)
