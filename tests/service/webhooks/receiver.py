"""A real HTTP server that receives webhooks and believes what it can verify with the reference library."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from standardwebhooks.webhooks import Webhook, WebhookVerificationError


@dataclass
class Receiver:
    """What came, and what is answered: first the given statuses in turn, then 200; to what cannot be verified, 401."""

    port: int
    secret: str = ""
    answers: list[int] = field(default_factory=list)
    ids: list[str] = field(default_factory=list)
    believed: list[dict[str, Any]] = field(default_factory=list)
    silent: threading.Event = field(default_factory=threading.Event)  # while it is set, nothing is answered

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/hook"

    def answer(self, headers: dict[str, str], body: bytes) -> int:
        self.ids.append(headers["webhook-id"])
        while self.silent.is_set():
            self.silent.wait(0.05)
            threading.Event().wait(0.05)
        try:
            message = Webhook(self.secret).verify(body, headers)
        except WebhookVerificationError:
            return 401
        status = self.answers.pop(0) if self.answers else 200
        if status == 200:
            self.believed.append(message)
        return status

    @contextmanager
    def running(self) -> Iterator[None]:
        """While the block runs, the receiver is up."""
        receiver = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                status = receiver.answer({name.lower(): value for name, value in self.headers.items()}, body)
                with suppress(OSError):  # whoever asked may be gone
                    self.send_response(status)
                    self.send_header("Content-Length", "0")
                    self.end_headers()

            def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002
                pass

        class Server(ThreadingHTTPServer):
            daemon_threads = False

            def server_bind(self) -> None:
                self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                super().server_bind()

        with Server(("127.0.0.1", self.port), Handler) as server:
            thread = threading.Thread(target=server.serve_forever, args=(0.05,))
            thread.start()
            try:
                yield
            finally:
                self.silent.clear()
                server.shutdown()
                thread.join()
