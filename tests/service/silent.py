"""A server that takes every connection and says nothing, as behind a network that swallows everything."""

import socket
import threading
from contextlib import suppress


class SilentServer:
    """Listens from the beginning, and hangs up when it is closed."""

    def __init__(self) -> None:
        self._lines: list[socket.socket] = []
        self._server = socket.create_server(("127.0.0.1", 0), backlog=100)
        self.address = f"127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._accept)
        self._thread.start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                self._lines.append(self._server.accept()[0])

    def left(self) -> int:
        """How many clients have given up waiting."""
        return sum(map(_has_left, self._lines))

    def close(self) -> None:
        self._server.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        for line in (self._server, *self._lines):
            line.close()


def _has_left(line: socket.socket) -> bool:
    try:
        while line.recv(65_536, socket.MSG_DONTWAIT):
            pass
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True
