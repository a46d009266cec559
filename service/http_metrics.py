"""Metrics of requests by the route that answered them."""

import time
from http import HTTPMethod

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.metrics import HTTP_BYTES, HTTP_REQUESTS, HTTP_SECONDS

ELSEWHERE = "other"  # label of unknown paths and methods, of which clients may invent any number
METHODS = frozenset(HTTPMethod)


class HttpMetrics:
    """Middleware that counts requests and their bytes, and times them until the answer is sent."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on and record its metrics."""
        if scope["type"] != "http":
            return await self.app(scope, receive, send)
        began, seconds, status = time.perf_counter(), 0.0, 500
        received = sent = 0

        async def counted_receive() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            return message

        async def counted_send(message: Message) -> None:
            nonlocal status, sent, seconds
            if message["type"] == "http.response.start":
                status = message["status"]
            sent += len(message.get("body", b""))
            await send(message)
            seconds = time.perf_counter() - began

        try:
            return await self.app(scope, counted_receive, counted_send)
        finally:
            method = scope["method"] if scope["method"] in METHODS else ELSEWHERE
            route = route_of(scope)
            HTTP_REQUESTS.labels(method, route, status).inc()
            HTTP_SECONDS.labels(method, route).observe(seconds)
            HTTP_BYTES.labels("in", route).inc(received)
            HTTP_BYTES.labels("out", route).inc(sent)


def route_of(scope: Scope) -> str:
    """Template of the path, such as `/v1/watermarks/{job_id}`."""
    return str(getattr(scope.get("route"), "path", ELSEWHERE))
