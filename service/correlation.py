"""What joins the log lines and spans of a job to those of the request that it came from.

It is kept with the job: a message may be lost, and need not be about the job that a worker then starts. It is only
looked at for that: nothing depends on it, and a job without it is as good.
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
    """That of a job which is recorded here and now."""
    carrier: dict[str, str] = {}
    TRACE.inject(carrier)
    carrier.pop("tracestate", None)  # of any length, and a client's
    request = current_request_id()
    return carrier | ({REQUEST: request} if request else {})


@contextmanager
def on_behalf_of(kept: Mapping[str, Any]) -> Iterator[None]:
    """Work on behalf of the request that a job came from."""
    request, parent = valid_request_id(kept.get(REQUEST)), kept.get("traceparent")
    trace = TRACE.extract({"traceparent": parent} if isinstance(parent, str) else {})
    token = context.attach(trace)
    try:
        with structlog.contextvars.bound_contextvars(**({"request": request} if request else {})):
            yield
    finally:
        context.detach(token)
