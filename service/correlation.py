"""What a message carries beside a job's id, so that the worker's log lines and spans join those of the request.

Whatever arrives is only looked at for that: nothing depends on it, and a message without it is as good.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import structlog
from opentelemetry import context
from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

from service.request_id import current_request_id, valid_request_id

REQUEST = "meshmark_request"
TRACE = TraceContextTextMapPropagator()  # W3C Trace Context


def outgoing() -> dict[str, str]:
    """The headers of a message sent here and now."""
    carrier: dict[str, str] = {}
    TRACE.inject(carrier)
    carrier.pop("tracestate", None)  # of any length, and a client's
    request = current_request_id()
    return carrier | ({REQUEST: request} if request else {})


@contextmanager
def incoming(headers: Mapping[str, Any]) -> Iterator[None]:
    """Work on behalf of the request that a message came from."""
    request, parent = valid_request_id(headers.get(REQUEST)), headers.get("traceparent")
    trace = TRACE.extract({"traceparent": parent} if isinstance(parent, str) else {})
    token = context.attach(trace)
    try:
        with structlog.contextvars.bound_contextvars(**({"request": request} if request else {})):
            yield
    finally:
        context.detach(token)
