"""Request bodies: small chunks are coalesced, and slow clients time out."""

import asyncio
import time
from contextlib import suppress

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode

LINGER, LINGER_BYTES = 2.0, 2**24  # seconds and bytes that are still read of a body after its answer
PIECE = 2**16  # bytes to which the chunks of a body are coalesced, however small a client sends them


class Bodies:
    """Middleware that coalesces the chunks of each request's body, and times out slow clients.

    Args:
        app: the next ASGI application.
        silence: seconds without a byte after which a body times out.
        rate: least average rate of a body, bytes per second, beyond the first `silence` seconds.
    """

    def __init__(self, app: ASGIApp, silence: float, rate: int) -> None:
        self.app, self.silence, self.rate = app, silence, rate

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] != "http":
            return await self.app(scope, receive, send)
        body = _Body(receive, self.silence, self.rate)

        async def answer(message: Message) -> None:
            body.is_answered = True
            if message["type"] == "http.response.body" and not message.get("more_body"):
                await send({**message, "more_body": True})
                await body.discard()
                message = {"type": "http.response.body", "body": b"", "more_body": False}
            await send(message)

        return await self.app(scope, body.receive, answer)


class _Body:
    def __init__(self, receive: Receive, silence: float, rate: int) -> None:
        self._receive, self._silence, self._rate = receive, silence, rate
        self._received, self._waited, self._is_complete = 0, 0.0, False
        self.is_answered = False  # then only the client's disconnect is awaited, not the body

    async def receive(self) -> Message:
        """Next message; chunks of the body are coalesced to PIECE bytes or more, except the last.

        Raises:
            MeshmarkError: ``request_timeout``.
        """
        if self._is_complete or self.is_answered:
            return await self._any()
        piece = bytearray()
        while len(piece) < PIECE and not self._is_complete:
            message = await self._next()
            if message["type"] != "http.request":
                return message
            piece += message.get("body", b"")
        return {"type": "http.request", "body": bytes(piece), "more_body": not self._is_complete}

    async def discard(self) -> None:
        """Drain the rest of the body for a moment after the answer.

        A connection closed while the client still sends may lose the answer (RFC 9112, section 9.6).
        """
        left = LINGER_BYTES
        with suppress(TimeoutError):
            async with asyncio.timeout(LINGER):
                while left > 0 and not self._is_complete:
                    left -= len((await self._any()).get("body", b""))

    async def _any(self) -> Message:
        message = await self._receive()
        self._is_complete = not message.get("more_body", False)  # also by http.disconnect
        return message

    async def _next(self) -> Message:
        # Only the time spent waiting for the client counts, not the processing in between.
        began = time.monotonic()
        timeout = min(self._silence, self._silence + self._received / self._rate - self._waited)
        try:
            async with asyncio.timeout(timeout):
                message = await self._any()
        except TimeoutError:
            if self.is_answered:
                return await self._any()
            raise MeshmarkError(
                ServiceErrorCode.REQUEST_TIMEOUT,
                f"The body stood still for {self._silence:g} seconds, or came at less than {self._rate:,} bytes a "
                "second.",
                "Send the request again, over a faster connection; the operator can raise the limits.",
            ) from None
        self._waited += time.monotonic() - began
        self._received += len(message.get("body", b""))
        return message
