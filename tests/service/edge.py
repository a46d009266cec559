"""A server in this process, and lines to it over which anything can be sent."""

import select
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import httpx2

from service.app import create_app
from service.config import Settings
from service.http_server import Server
from service.jobs.ledger import Ledger
from service.jobs.tenants import Scope, create_key
from service.state import AppState
from tests.service.harness import free_port
from tests.worker.waiting import PATIENCE, wait_until


class Line:
    """A connection, and what was sent over it; whatever the server does, reading from it ends."""

    def __init__(self, port: int, data: bytes = b"", receive_buffer: int | None = None) -> None:
        self.socket = socket.socket()
        self.socket.settimeout(PATIENCE)
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.connect(("127.0.0.1", port))
        self.socket.sendall(data)

    def send(self, data: bytes) -> bool:
        """Whether the server still took it."""
        try:
            self.socket.sendall(data)
        except OSError:
            return False
        return True

    def until_closed(self) -> bytes:
        """All that comes until the server closes the line."""
        received = b""
        with suppress(ConnectionError):
            while piece := self.socket.recv(65_536):
                received += piece
        return received

    def is_readable(self) -> bool:
        """Whether something came, or the line was closed."""
        return bool(select.select([self.socket], [], [], 0)[0])

    def is_closed(self) -> bool:
        """Whether the server has closed the line; it must not have answered."""
        if not self.is_readable():
            return False
        try:
            return self.socket.recv(1) == b""
        except ConnectionError:
            return True


class Edge:
    """A server that asks for keys, and those of two tenants."""

    def __init__(self, settings: Settings) -> None:
        self.port, self.settings = settings.port, settings
        self.app = create_app(settings)
        self.server = Server(self.app, settings)
        self._lines: list[Line] = []
        self._thread = threading.Thread(target=self.server.run)
        self._thread.start()
        wait_until(lambda: self.server.started and self.answers())
        self.state: AppState = self.app.state.meshmark
        ledger = Ledger(settings.ledger_url)
        self.keys = [create_key(ledger.sessions, name, name, [*Scope], None).text for name in ("alice", "bobby")]
        ledger.close()

    def client(self, tenant: int = 0) -> httpx2.Client:
        headers = {"Authorization": f"Bearer {self.keys[tenant]}"}
        return httpx2.Client(base_url=f"http://127.0.0.1:{self.port}", timeout=PATIENCE, headers=headers)

    def line(self, data: bytes = b"", **options: Any) -> Line:
        self._lines.append(Line(self.port, data, **options))
        return self._lines[-1]

    def head(self, request: str, *headers: str) -> bytes:
        """The headers of a request of the first tenant's."""
        lines = [f"{request} HTTP/1.1", "Host: a", f"Authorization: Bearer {self.keys[0]}", *headers, "", ""]
        return "\r\n".join(lines).encode()

    def answers(self) -> bool:
        try:
            return httpx2.get(f"http://127.0.0.1:{self.port}/healthz", timeout=PATIENCE).status_code == 200
        except httpx2.TransportError:
            return False

    def close(self) -> None:
        for line in self._lines:
            line.socket.close()
        self.server.should_exit = True
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


@contextmanager
def edge_with(**settings: Any) -> Iterator[Edge]:
    """A server with these settings."""
    edge = Edge(Settings(port=free_port(), auth="keys", requests_per_minute=0, **settings))
    try:
        yield edge
    finally:
        edge.close()
