"""A proxy before a server that cuts connections, and answers in its place, when it is told to."""

import re
import select
import socket
import struct
import threading
from contextlib import suppress
from dataclasses import dataclass

from tests.service.harness import free_port
from tests.worker.waiting import PATIENCE

HEAD = re.compile(rb"(GET|POST|PUT|DELETE) (\S+) HTTP/1.1\r\n(.*?)\r\n\r\n", re.DOTALL)
LENGTH = re.compile(rb"content-length: (\d+)", re.IGNORECASE)


@dataclass(frozen=True)
class Fault:
    """What happens to a request whose head begins so: its answer is cut after so many bytes, or is another one.

    In that, START stands for the first byte that the request asks for.
    """

    head: str
    after: int = 0
    answer: bytes | None = None


class Request:
    """The head of a request that came."""

    def __init__(self, method: bytes, target: bytes, headers: bytes) -> None:
        self.line = f"{method.decode()} {target.decode()}"
        pairs = (line.partition(": ")[::2] for line in headers.decode().split("\r\n"))
        self.headers = {name.lower(): value for name, value in pairs}
        self.start = self.headers.get("range", "").removeprefix("bytes=").partition("-")[0]


class Proxy:
    """A proxy in threads of this process; each fault happens once, in their order."""

    def __init__(self, port: int) -> None:
        self.port, self._upstream = free_port(), port
        self.requests: list[Request] = []
        self.faults: list[Fault] = []
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()
        self._open: list[socket.socket] = []

    def lines(self, begin: str = "") -> list[str]:
        """Methods and targets of the requests that came."""
        return [request.line for request in self.requests if request.line.startswith(begin)]

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        for client in self._open:
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(PATIENCE)
        self._listener.close()

    def _accept(self) -> None:
        with suppress(OSError):  # the listener is shut down
            while True:
                client, _ = self._listener.accept()
                self._open.append(client)
                thread = threading.Thread(target=self._serve, args=(client,))
                self._threads.append(thread)
                thread.start()

    def _serve(self, client: socket.socket) -> None:
        with client, socket.create_connection(("127.0.0.1", self._upstream)) as server, suppress(OSError):
            pending, left = b"", None
            while True:
                for ready in select.select([client, server], [], [])[0]:
                    data = ready.recv(65_536)
                    if not data:
                        return
                    if ready is server:
                        client.sendall(data if left is None else data[:left])
                        if left is not None and (left := left - len(data)) <= 0:
                            reset(client)
                            return
                        continue
                    pending += data
                    while whole := _whole(pending):
                        request, pending = pending[:whole], pending[whole:]
                        fault = self._note(request)
                        if fault and fault.answer is not None:
                            client.sendall(fault.answer.replace(b"START", self.requests[-1].start.encode()))
                            return
                        left = fault.after if fault else None
                        server.sendall(request)
                        if left == 0:  # the server answers, and nobody hears it
                            server.recv(1)
                            reset(client)
                            return

    def _note(self, request: bytes) -> Fault | None:
        found = HEAD.match(request)
        assert found is not None, request
        self.requests.append(Request(*found.groups()))
        if self.faults and self.requests[-1].line.startswith(self.faults[0].head):
            return self.faults.pop(0)
        return None


def _whole(pending: bytes) -> int:
    """The length of the first request in what came; 0 while it has not come whole."""
    found = HEAD.match(pending)
    if found is None:
        return 0
    declared = LENGTH.search(found[3])
    length = found.end() + (int(declared[1]) if declared else 0)
    return length if len(pending) >= length else 0


def reset(connection: socket.socket) -> None:
    """Have a connection reset when it is closed."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def answer(status: str, body: bytes = b"", missing: int = 0, **headers: str) -> bytes:
    """An answer after which the connection is closed, and so many bytes before its end."""
    lines = [f"HTTP/1.1 {status}", f"Content-Length: {len(body) + missing}", "Connection: close"]
    lines += [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
    return "\r\n".join([*lines, "", ""]).encode() + body
