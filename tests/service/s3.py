"""A real server that speaks S3 (moto), and a way to make it fail: both on free loopback ports."""

import http.client
import socket
import sys
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx2
from pydantic import SecretStr

from service.config import Settings
from tests.service.harness import free_port, running
from tests.worker.waiting import wait_until

KEYS = {"s3_access_key_id": "key-of-the-tests", "s3_secret_access_key": "secret-of-the-tests"}


@dataclass
class Bucket:
    """An empty bucket, and what a service needs to be told to use it."""

    endpoint: str
    name: str

    @property
    def settings(self) -> dict[str, str]:
        return {"store_url": f"s3://{self.name}/some/prefix", "s3_endpoint": self.endpoint, **KEYS}


def bucket_settings(bucket: Bucket, data_dir: Path, **more: Any) -> Settings:
    secrets = {name: SecretStr(value) for name, value in KEYS.items()}
    return Settings(data_dir=data_dir, **{**bucket.settings, **secrets, **more})


@dataclass
class S3:
    """The server."""

    url: str

    def new_bucket(self) -> Bucket:
        name = f"bucket-{uuid.uuid4().hex}"
        assert httpx2.put(f"{self.url}/{name}").status_code == 200
        return Bucket(self.url, name)


@contextmanager
def s3_server() -> Iterator[S3]:
    """A running server, empty at first."""
    port = free_port()
    command = [sys.executable, "-W", "ignore", "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    with running(command, {}, quiet=True):

        def listens() -> bool:
            with socket.socket() as probe:
                return probe.connect_ex(("127.0.0.1", port)) == 0

        wait_until(listens)
        yield S3(f"http://127.0.0.1:{port}")


class Flaky:
    """Passes requests on to a server, or answers them all with 500."""

    def __init__(self, server: str) -> None:
        self.failing = threading.Event()
        self.failed = 0
        upstream, outer = server.removeprefix("http://"), self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def answer(self) -> None:
                body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
                if outer.failing.is_set():
                    outer.failed += 1
                    status, headers, content = 500, [], b"<Error><Code>InternalError</Code></Error>"
                else:
                    connection = http.client.HTTPConnection(upstream)
                    connection.request(self.command, self.path, body, dict(self.headers.items()))
                    answer = connection.getresponse()
                    status, headers, content = answer.status, answer.getheaders(), answer.read()
                    connection.close()
                self.send_response_only(status)
                length = None
                for name, value in headers:
                    if name.lower() == "content-length":
                        length = value
                    elif name.lower() not in ("transfer-encoding", "connection"):
                        self.send_header(name, value)
                self.send_header("Content-Length", length if self.command == "HEAD" and length else str(len(content)))
                self.end_headers()
                if self.command != "HEAD":
                    self.wfile.write(content)

            do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = answer  # noqa: N815

            def log_message(self, *_: Any) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.05})

    @contextmanager
    def running(self) -> Iterator["Flaky"]:
        self._thread.start()
        try:
            yield self
        finally:
            self._server.shutdown()
            self._server.server_close()
            self._thread.join()
