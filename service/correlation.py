"""Correlation of a job's log lines and spans with those of the request that it came from.

It is stored with the job, not in its message: a message may be lost, and need not be about the job that a worker then
starts. Nothing else depends on it, and a job may have none.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import structlog
from opentelemetry import context
from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

from service.request_id import current_request_id, valid_request_id

REQUEST = "request"
TRACE = TraceContextTextMapPropagator()  # W3C Trace Context


def correlation() -> dict[str, str]:
    """Correlation of a job recorded now: the request's id and trace parent, as far as there are any."""
    carrier: dict[str, str] = {}
    TRACE.inject(carrier)
    carrier.pop("tracestate", None)  # of any length, and set by clients
    request = current_request_id()
    return carrier | ({REQUEST: request} if request else {})


@contextmanager
def on_behalf_of(kept: Mapping[str, Any]) -> Iterator[None]:
    """Run the block in the log context and trace of the request that a job came from."""
    request, parent = valid_request_id(kept.get(REQUEST)), kept.get("traceparent")
    trace = TRACE.extract({"traceparent": parent} if isinstance(parent, str) else {})
    token = context.attach(trace)
    try:
        with structlog.contextvars.bound_contextvars(**({"request": request} if request else {})):
            yield
    finally:
        context.detach(token)
