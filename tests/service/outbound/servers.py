"""Real servers on loopback that answer byte by byte as a test wants, and clients that may reach them."""

import re
import socket
import ssl
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from ipaddress import ip_network
from threading import Thread

from service.outbound.client import OutboundClient
from service.outbound.policy import Policy, Timeouts
from service.outbound.resolve import Resolver
from tests.worker.waiting import PATIENCE

NAME = "files.example"  # resolves nowhere but in these tests
LOOPBACK = ip_network("127.0.0.0/8")
BRIEF = Timeouts(connect=1.0, silence=0.5, total=1.0)  # for servers that do not answer
LONG = Timeouts(connect=PATIENCE, silence=PATIENCE, total=PATIENCE)

Script = Callable[[socket.socket], None]


class Server:
    """Runs its script for each connection in a thread; remembers the names it was asked for by SNI.

    A script ends at the latest when the client is gone.
    """

    def __init__(self, script: Script, tls: ssl.SSLContext | None, host: str, port: int) -> None:
        self.connections = 0
        self.names: list[str | None] = []
        self._script = script
        self._tls = tls
        if tls:
            tls.sni_callback = lambda _connection, name, _context: self.names.append(name)
        self._listener = socket.create_server((host, port))
        self.port: int = self._listener.getsockname()[1]
        self._threads: list[Thread] = [Thread(target=self._accept)]
        self._threads[0].start()

    def url(self, path: str = "/", host: str = NAME) -> str:
        return f"{'https' if self._tls else 'http'}://{host}:{self.port}{path}"

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:  # the first is the one that adds others, and has ended when it is joined
            thread.join()
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            self.connections += 1
            connection.settimeout(PATIENCE)
            self._threads.append(Thread(target=self._serve, args=(connection,)))
            self._threads[-1].start()

    def _serve(self, connection: socket.socket) -> None:
        with connection, suppress(OSError):
            if self._tls is None:
                self._script(connection)
            else:
                with self._tls.wrap_socket(connection, server_side=True) as encrypted:
                    self._script(encrypted)


@contextmanager
def serving(
    script: Script, tls: ssl.SSLContext | None = None, host: str = "127.0.0.1", port: int = 0
) -> Iterator[Server]:
    """A server on a free port."""
    server = Server(script, tls, host, port)
    try:
        yield server
    finally:
        server.close()


def read_request(connection: socket.socket) -> tuple[bytes, bytes]:
    """The head and the body of one request."""
    received = b""
    while b"\r\n\r\n" not in received:
        received += _receive(connection)
    head, _, body = received.partition(b"\r\n\r\n")
    declared = re.search(rb"(?i)content-length: (\d+)", head)
    while declared and len(body) < int(declared[1]):
        body += _receive(connection)
    return head, body


def _receive(connection: socket.socket) -> bytes:
    received = connection.recv(65536)
    if not received:
        raise ConnectionError("the client has gone")
    return received


def replying(*parts: bytes, requests: list[tuple[bytes, bytes]] | None = None) -> Script:
    """Reads a request, notes it, and sends these bytes."""

    def script(connection: socket.socket) -> None:
        request = read_request(connection)
        if requests is not None:
            requests.append(request)
        for part in parts:
            connection.sendall(part)

    return script


def response(body: bytes = b"", status: str = "200 OK", **headers: str) -> bytes:
    """A response with its right length."""
    fields = {"Content-Length": str(len(body))} | {name.replace("_", "-"): value for name, value in headers.items()}
    head = "".join(f"{name}: {value}\r\n" for name, value in fields.items())
    return f"HTTP/1.1 {status}\r\n{head}\r\n".encode() + body


def at(*addresses: str) -> Resolver:
    """A resolver that finds these addresses for every name."""
    return lambda _host: addresses


def client_of(
    *servers: Server,
    tls: ssl.SSLContext | None = None,
    resolver: Resolver | None = None,
    timeouts: Timeouts = LONG,
    allow: str = str(LOOPBACK),
) -> OutboundClient:
    """A client that may reach these servers' ports on loopback, over https and http."""
    ports = frozenset(server.port for server in servers)
    policy = Policy(allow=(ip_network(allow),), schemes=frozenset({"http", "https"}), ports=ports)
    return OutboundClient(policy, timeouts, resolver or at("127.0.0.1"), tls)
