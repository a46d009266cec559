"""Request bodies as they come: gathered into large pieces, and given up where they stand still."""

import asyncio
import time
from contextlib import suppress

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode

LINGER, LINGER_BYTES = 2.0, 2**24  # seconds, and what may come in them
PIECE = 2**16  # bytes; however small the pieces a client sends, work is done for each of these only


class Bodies:
    """Gathers each request's body, and ends requests whose body does not come.

    Args:
        app: what is behind it.
        silence: seconds for which a body may stand still.
        rate: bytes a second that must come on average, beyond the first `silence` seconds.
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
        self.is_answered = False  # then nobody waits for the body any more, only for the client to leave

    async def receive(self) -> Message:
        """The next message, of at least a piece where the body has so much.

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
        """Read for a moment what comes after the answer.

        A line that is closed while the client still sends takes the answer with it (RFC 9112, section 9.6).
        """
        left = LINGER_BYTES
        with suppress(TimeoutError):
            async with asyncio.timeout(LINGER):
                while left > 0 and not self._is_complete:
                    left -= len((await self._any()).get("body", b""))

    async def _any(self) -> Message:
        message = await self._receive()
        self._is_complete = not message.get("more_body", False)  # so it is when the client has left, too
        return message

    async def _next(self) -> Message:
        # Only the time in which the client is waited for counts, not what is done with what came.
        began = time.monotonic()
        patience = min(self._silence, self._silence + self._received / self._rate - self._waited)
        try:
            async with asyncio.timeout(patience):
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
