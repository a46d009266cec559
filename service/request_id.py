"""Request ids: one for a request and all log lines that it causes, in every process.

It comes from the client's `X-Request-ID` or is drawn here, is in the answer, is kept with the
job that is made (see :mod:`service.correlation`), and so is in the lines of the worker and of the engine's process too.
"""

import re
import time
import uuid
from http import HTTPStatus
from logging import DEBUG, INFO

import structlog
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from core.validation import shortened

HEADER = "X-Request-ID"
PROBES = ("/healthz", "/readyz")
LONGEST_PATH = 300  # characters of a path that are logged
VALID = re.compile(r"[A-Za-z0-9._:@+/=-]{1,128}")

log = structlog.get_logger(__name__)


def valid_request_id(text: object) -> str | None:
    """Return the id if it is valid, else None; any other text would let clients inject into logs."""
    return text if isinstance(text, str) and VALID.fullmatch(text) else None


def current_request_id() -> str | None:
    """Id of the request being handled in this context."""
    return valid_request_id(structlog.contextvars.get_contextvars().get("request"))


class RequestId:
    """Middleware that gives each request its id, and logs its answer."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] != "http":
            return await self.app(scope, receive, send)
        given = dict(scope["headers"]).get(HEADER.lower().encode(), b"").decode("latin-1")
        identity = valid_request_id(given) or str(uuid.uuid4())
        began, seconds, status = time.perf_counter(), 0.0, 500

        async def send_with_id(message: Message) -> None:
            nonlocal status, seconds
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)[HEADER] = identity
            await send(message)
            seconds = time.perf_counter() - began  # without background work after the answer

        with structlog.contextvars.bound_contextvars(request=identity):
            try:
                return await self.app(scope, receive, send_with_id)
            finally:
                well = scope["path"] in PROBES and status < HTTPStatus.BAD_REQUEST  # every few seconds, for ever
                log.log(
                    DEBUG if well else INFO,
                    "request answered",
                    method=scope["method"],
                    path=shortened(scope["path"], LONGEST_PATH),
                    status=status,
                    seconds=round(seconds, 4),
                )
