"""The HTTP server: uvicorn, with bounds on what a connection may take before and beside the application.

Every client, with a key or without, is bounded by: a number of connections, beyond which the one that has been idle
before its request for longest is closed; a time in which headers must arrive, and in which a slow client must take some
of an answer; a size of headers, and of framing; and strict parsing by RFC 9112. Refusals are problem details, too.
"""

import asyncio
import resource
import socket
import sys
from typing import Any

import httptools
import structlog
import uvicorn
from fastapi import FastAPI
from uvicorn.config import STARTUP_FAILURE
from uvicorn.protocols.http.flow_control import FlowControl
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol
from uvicorn.server import ServerState

from core.errors import Code, ErrorCode, MeshmarkError
from service.config import Settings
from service.errors import ServiceErrorCode
from service.problems import problem_response

MOST_HEADERS = 2**16  # bytes
# Bytes of chunk framing (lengths, extensions, trailers) beyond half as many as the body has. The smaller a chunk, the
# more time it costs for each byte.
MOST_FRAMING = 2**13
PIECE = 2**13  # bytes that are parsed before they are counted
BACKLOG = 2048  # connections that the kernel holds before they are accepted
SLOW_PARSE, PAUSE_FACTOR = 0.001, 3  # seconds of parsing a chunk that cause a pause; its length in multiples of them
REFUSAL_DELAY = 0.5  # seconds until what is no proper HTTP is answered: who sends it again and again is held up himself
REQUEST_GRACE = 0.5  # seconds a new connection has to send its request before it may be closed for another one
PAUSE = 1.0  # seconds between two attempts to accept after a failure, and between two log lines of a kind
DESCRIPTORS = 1024  # file descriptors for all but connections

log = structlog.get_logger("service")


class Server(uvicorn.Server):
    """uvicorn, except that it accepts connections itself to bound them, and ends event streams and waiting uploads at
    shutdown."""

    def __init__(self, app: FastAPI, settings: Settings) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                settings.host,
                settings.port,
                http=Connection,
                ws="none",
                log_config=None,
                access_log=False,  # service.request_id logs each answer
                timeout_graceful_shutdown=5,
            )
        )
        self._app = app
        self._timeout = settings.client_timeout
        self._most = connection_limit(settings.max_connections)
        self._waiting: dict[Connection, float] = {}
        self._listeners: list[socket.socket] = []
        self._accepting: list[asyncio.Task[None]] = []
        self._warned_at = 0.0

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:  # noqa: ARG002
        """Start the application, then listen."""
        await super().startup(sockets=[])
        loop = asyncio.get_running_loop()
        try:
            bound = await loop.create_server(asyncio.Protocol, self.config.host, self.config.port, start_serving=False)
        except OSError as error:
            log.error("the service cannot listen", error=str(error))
            await self.lifespan.shutdown()
            sys.exit(STARTUP_FAILURE)
        self._listeners = [listener.dup() for listener in bound.sockets]
        bound.close()
        for listener in self._listeners:
            listener.setblocking(False)
            listener.listen(BACKLOG)
        self._accepting = [asyncio.create_task(self._accept(listener)) for listener in self._listeners]
        address, port = self._listeners[0].getsockname()[:2]
        log.info("ready", address=address, port=port)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop."""
        for task in self._accepting:
            task.cancel()
        for listener in self._listeners:
            listener.close()
        self._app.state.meshmark.streams.stop()
        self._app.state.meshmark.intake.close()
        await super().shutdown(sockets)
        log.info("stopped")

    async def _accept(self, listener: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, _ = await loop.sock_accept(listener)
                await self._wait_for_slot()
                await loop.connect_accepted_socket(self._connection, accepted)
            except ConnectionError:  # the client has left
                continue
            except Exception as error:
                self._warn("a connection could not be accepted", error=str(error))
                await asyncio.sleep(PAUSE)

    async def _wait_for_slot(self) -> None:
        """Wait for a free connection; of those that wait for a request, close the one that has done so longest.

        So idle connections keep nobody out, however many there are.
        """
        while len(self.server_state.connections) >= self._most:
            self._warn("all connections are taken", most=self._most)
            oldest = next(iter(self._waiting), None)
            if oldest is not None and self._waiting[oldest] <= asyncio.get_running_loop().time() - REQUEST_GRACE:
                oldest.abort()
                await asyncio.sleep(0)  # it is gone afterwards
            else:
                await asyncio.sleep(REQUEST_GRACE / 10)

    def _connection(self) -> "Connection":
        return Connection(self.config, self.server_state, self.lifespan.state, self._waiting, self._timeout)

    def _warn(self, event: str, **details: object) -> None:
        moment = asyncio.get_running_loop().time()
        if moment >= self._warned_at + PAUSE:
            self._warned_at = moment
            log.warning(event, **details)


class Flow(FlowControl):
    """Flow control of uvicorn, with pauses in which nothing is read even if the application is ready."""

    def __init__(self, transport: asyncio.Transport) -> None:
        super().__init__(transport)
        self._is_paused = False

    def pause_for(self, loop: asyncio.AbstractEventLoop, seconds: float) -> None:
        """Pause reading for so many seconds."""
        self._is_paused = True
        self._transport.pause_reading()
        loop.call_later(seconds, self._read_on)

    def resume_reading(self) -> None:
        """Read on, after the pause if there is one."""
        if self._is_paused:
            self.read_paused = False
        else:
            super().resume_reading()

    def _read_on(self) -> None:
        self._is_paused = False
        if not self.read_paused:
            self._transport.resume_reading()


class Connection(HttpToolsProtocol):
    """Connection of uvicorn with time-outs, and with a strict parser that accepts nothing ambiguous.

    Args:
        config: uvicorn's.
        server_state: uvicorn's.
        app_state: uvicorn's.
        waiting: start times of the connections that wait for a request, the earliest first.
        timeout: seconds in which the headers of a request must arrive, and the client must take some of an answer.
    """

    def __init__(
        self,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        waiting: dict["Connection", float],
        timeout: float,
    ) -> None:
        super().__init__(config, server_state, app_state)
        self.parser = httptools.HttpRequestParser(self)  # uvicorn's is lenient
        self._waiting, self._timeout = waiting, timeout
        self._headers_due: asyncio.TimerHandle | None = None
        self._answer_due: asyncio.TimerHandle | None = None
        self._is_in_headers = self._is_refused = False
        self._body_bytes = self._other_bytes = 0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self.flow = self._flow = Flow(transport)
        if connected := transport.get_extra_info("socket"):  # the kernel closes it if sent bytes are not acknowledged
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(self._timeout * 1000))
        self._wait_for_headers()

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the timers."""
        self._stop_waiting()
        self._unset_answer_due()
        super().connection_lost(exc)

    def abort(self) -> None:
        """Abort the connection, in favour of others."""
        self._stop_waiting()
        self.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Parse received bytes. After bytes that are slow to parse, such as small chunks, reading pauses."""
        self._unset_keepalive_if_required()
        if not self._is_refused:
            began = self.loop.time()
            self._read(data)
            if (spent := self.loop.time() - began) > SLOW_PARSE:
                self._flow.pause_for(self.loop, PAUSE_FACTOR * spent)

    def _read(self, data: bytes) -> None:
        left = memoryview(data)
        try:
            while left and not self._is_refused:
                piece, left = left[:PIECE], left[PIECE:]
                self._other_bytes += len(piece)
                try:
                    self.parser.feed_data(piece)
                except httptools.HttpParserUpgrade as upgrade:
                    self._other_bytes = 0
                    left = memoryview(self._without_upgrade() + piece[upgrade.args[0] :] + left)
                self._check_size()
        except httptools.HttpParserError:
            self._refuse(
                ErrorCode.INVALID_REQUEST,
                "The request is not HTTP/1.1 as RFC 9112 describes it.",
                "Send it with an HTTP client, without a proxy that changes it.",
            )

    def _check_size(self) -> None:
        if self._is_in_headers and self._other_bytes > MOST_HEADERS:
            self._refuse(
                ErrorCode.INVALID_REQUEST,
                "The headers of the request are too large.",
                f"Send less than {MOST_HEADERS:,} bytes of headers.",
            )
        elif not self._is_in_headers and self._other_bytes > MOST_FRAMING + self._body_bytes // 2:
            self._refuse(
                ErrorCode.INVALID_REQUEST,
                "The body of the request comes in chunks that are too small.",
                "Send it in chunks of some kilobytes, or with its Content-Length.",
            )

    def on_message_begin(self) -> None:
        """Begin a request."""
        super().on_message_begin()
        self._is_in_headers = True

    def on_header(self, name: bytes, value: bytes) -> None:
        """Record a header; trailers are ignored."""
        if self._is_in_headers:
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Start the application, if the framing of the request is unambiguous.

        Raises:
            ValueError: it is not, or the request is not supported; the parser makes an error of its own of it.
        """
        version = self.parser.get_http_version()
        if self.parser.get_method() == b"CONNECT" or version not in ("1.0", "1.1"):
            raise ValueError("no request for this service")
        if self.parser.should_upgrade():  # see `_without_upgrade`
            return
        codings = [value.lower() for name, value in self.headers if name == b"transfer-encoding"]
        hosts = [value for name, value in self.headers if name == b"host"]
        if codings and (version == "1.0" or codings != [b"chunked"]):
            raise ValueError("a transfer coding that is not known")
        if len(hosts) > 1 or (version == "1.1" and not hosts):
            raise ValueError("not one host")
        self._is_in_headers = False
        self._other_bytes -= len(self.url) + sum(len(name) + len(value) for name, value in self.headers)
        self._stop_waiting()
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Count a chunk of the body and pass it on."""
        self._body_bytes += len(body)
        self._other_bytes -= len(body)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """End a request that has arrived as a whole."""
        if self.parser.should_upgrade():
            return
        self._body_bytes = self._other_bytes = 0
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """Continue with the next request, or wait for one."""
        super().on_response_complete()
        if self.timeout_keep_alive_task is not None:
            self._wait_for_headers()

    def pause_writing(self) -> None:
        """Start the time-out of a slow client."""
        super().pause_writing()
        self._answer_due = self.loop.call_later(self._timeout, self.transport.abort)

    def resume_writing(self) -> None:
        """Stop the time-out: the client has taken some of the answer."""
        self._unset_answer_due()
        super().resume_writing()

    def _without_upgrade(self) -> bytes:
        """Request line and headers without the field Upgrade, for a new parser.

        A server may ignore that field (RFC 9110, section 7.8), but this parser takes the rest for the other protocol:
        the body of the request would be lost, or read as a request if it arrives a moment later.
        """
        lines = [b"%s %s HTTP/%s" % (self.parser.get_method(), self.url, self.parser.get_http_version().encode())]
        lines += [b"%s: %s" % (name, value) for name, value in self.headers if name != b"upgrade"]
        self.parser = httptools.HttpRequestParser(self)
        return b"\r\n".join([*lines, b"", b""])

    def _wait_for_headers(self) -> None:
        self._stop_waiting()
        self._waiting[self] = self.loop.time()
        self._headers_due = self.loop.call_later(self._timeout, self._give_up)

    def _stop_waiting(self) -> None:
        self._waiting.pop(self, None)
        if self._headers_due is not None:
            self._headers_due.cancel()
            self._headers_due = None

    def _unset_answer_due(self) -> None:
        if self._answer_due is not None:
            self._answer_due.cancel()
            self._answer_due = None

    def _give_up(self) -> None:
        if self._is_in_headers:
            self._refuse(
                ServiceErrorCode.REQUEST_TIMEOUT,
                f"The headers of the request did not come within {self._timeout:g} seconds.",
                "Send the request again, at once as a whole.",
            )
        else:  # not a byte came
            self.abort()

    def _refuse(self, code: Code, message: str, remedy: str) -> None:
        """Stop reading from the connection, and answer the current request with a problem."""
        self._is_refused = True
        self._stop_waiting()
        current = self.cycle
        if current is not None and not current.response_complete:
            if not current.more_body:  # the error came after this request, which is still answered
                current.keep_alive = False
                return
            current.disconnected = True  # the application may go on; its answer is dropped
            current.message_event.set()
            if current.response_started:
                self.transport.close()
        if self.transport.is_closing():
            return
        response = problem_response(MeshmarkError(code, message, remedy), {"Connection": "close"})
        headers = [*self.server_state.default_headers, *response.raw_headers]
        lines = [b"%s: %s\r\n" % (name, value) for name, value in headers]
        answer = b"".join([STATUS_LINE[response.status_code], *lines, b"\r\n", bytes(response.body)])
        self.transport.pause_reading()
        self.loop.call_later(REFUSAL_DELAY, self._close_with, answer)

    def _close_with(self, answer: bytes) -> None:
        if not self.transport.is_closing():
            self.transport.write(answer)
            self.transport.close()


def connection_limit(wanted: int) -> int:
    """Number of connections that can be open at a time: as many as wanted, if the process may have the descriptors.

    The soft limit is raised as far as needed and allowed by the hard limit. Half of the descriptors are kept for other
    things: an upload has files too.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    enough = 2 * wanted + DESCRIPTORS
    if soft != resource.RLIM_INFINITY and soft < enough:
        soft = enough if hard == resource.RLIM_INFINITY else min(enough, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    if soft == resource.RLIM_INFINITY or wanted <= soft // 2:
        return wanted
    log.warning("few descriptors are allowed, and so few connections", connections=soft // 2, descriptors=soft)
    return soft // 2
