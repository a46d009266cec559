"""A real store that speaks S3 (SeaweedFS), and a way to make it fail: both on free loopback ports."""

import contextlib
import http.client
import json
import os
import signal
import subprocess
import sysconfig
import tempfile
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx2
import obstore
import pytest
from obstore.store import S3Store
from pydantic import SecretStr

from service.config import Settings
from tests.service.harness import free_port
from tests.worker.waiting import PATIENCE, wait_until

KEYS = {"s3_access_key_id": "key-of-the-tests", "s3_secret_access_key": "secret-of-the-tests"}
SERVERS = ("master", "volume", "filer", "s3")  # of one process, each with a port for HTTP and one for gRPC
ADMIN = {"s3_access_key_id": "key-of-the-operator", "s3_secret_access_key": "secret-of-the-operator"}


def identity(keys: dict[str, str], *actions: str) -> dict[str, Any]:
    """Somebody with keys, as the server is told of: `Write` is to put and delete, `Admin` is to make buckets too."""
    credentials = {"accessKey": keys["s3_access_key_id"], "secretKey": keys["s3_secret_access_key"]}
    return {"name": keys["s3_access_key_id"], "actions": actions, "credentials": [credentials]}


@dataclass
class Bucket:
    """An empty bucket, and what a service needs to be told to use it."""

    endpoint: str
    name: str

    @property
    def settings(self) -> dict[str, str]:
        return {"store_url": f"s3://{self.name}/some/prefix", "s3_endpoint": self.endpoint, **KEYS}

    def open(self, keys: dict[str, str] = KEYS) -> S3Store:
        """The whole bucket."""
        return S3Store(
            self.name,
            endpoint=self.endpoint,
            access_key_id=keys["s3_access_key_id"],
            secret_access_key=keys["s3_secret_access_key"],
            client_options={"allow_http": True},
        )


def bucket_settings(bucket: Bucket, data_dir: Path, **more: Any) -> Settings:
    secrets = {name: SecretStr(value) for name, value in KEYS.items()}
    return Settings(data_dir=data_dir, **{**bucket.settings, **secrets, **more})


class S3:
    """The server, which may be stopped and started again."""

    def __init__(self, folder: Path, *identities: dict[str, Any]) -> None:
        self._folder, self._ports = folder, {name: (free_port(), free_port()) for name in SERVERS}
        self.url = f"http://127.0.0.1:{self._ports['s3'][0]}"
        (folder / "identities.json").write_text(json.dumps({"identities": [identity(ADMIN, "Admin"), *identities]}))

    def start(self) -> None:
        """Start the server and wait until it answers."""
        options = [f"-{name}.port={ports[0]}" for name, ports in self._ports.items()]
        options += [f"-{name}.port.grpc={ports[1]}" for name, ports in self._ports.items()]
        options += [f"-{name}.localSocket={self._folder / name}.sock" for name in ("filer", "s3")]
        command = [
            *(weed(), "-logtostderr", "server", f"-dir={self._folder}", "-ip=127.0.0.1", "-ip.bind=127.0.0.1"),
            *("-master.peers=none", "-master.volumeSizeLimitMB=64", "-volume.max=1000"),
            *("-s3", f"-s3.config={self._folder / 'identities.json'}", "-s3.port.iceberg=0", *options),
        ]
        # Each bucket has volumes of its own: one at a time is enough here, and is there sooner than seven.
        environment = {"WEED_MASTER_VOLUME_GROWTH_COPY_1": "1", "HOME": os.fspath(self._folder)}
        with (self._folder / "log").open("ab") as log:
            self.process = subprocess.Popen(
                command, env=os.environ | environment, cwd=self._folder, stdout=log, stderr=log, start_new_session=True
            )
        wait_until(self._answers)

    def end(self) -> None:
        """Kill it: it takes half a minute to end when it is asked to, and a store must bear it."""
        self.process.kill()
        self.process.wait(PATIENCE)
        for _, port in self._ports.values():
            for socket in Path("/tmp").glob(f"seaweedfs-*-grpc-{port}.sock"):  # where it puts them, whatever it is told
                socket.unlink()

    @contextmanager
    def hanging(self) -> Iterator[None]:
        """It takes connections and says nothing."""
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.wake()

    def wake(self) -> None:
        """It goes on, if it hangs."""
        self.process.send_signal(signal.SIGCONT)

    def new_bucket(self, name: str = "") -> Bucket:
        bucket = Bucket(self.url, name or f"bucket-{uuid.uuid4().hex}")
        # obstore makes no buckets, but it signs what does: a PUT of the bucket itself.
        answer = httpx2.put(obstore.sign(bucket.open(ADMIN), "PUT", "", timedelta(minutes=1)))
        assert answer.status_code == 200, answer.text
        return bucket

    def _answers(self) -> bool:
        assert self.process.poll() is None, f"SeaweedFS did not start: {(self._folder / 'log').read_text()[-2000:]}"
        with contextlib.suppress(httpx2.TransportError):
            return httpx2.get(f"{self.url}/healthz").status_code == 200
        return False


def weed() -> str:
    """SeaweedFS's one program, as its package on PyPI brings it."""
    program = Path(sysconfig.get_path("scripts"), "weed")
    if not program.exists():
        pytest.fail("SeaweedFS is not installed: pip install '.[test]'", pytrace=False)
    return os.fspath(program)


@contextmanager
def s3_server(*identities: dict[str, Any]) -> Iterator[S3]:
    """A running server, empty at first, that lets in the tests' services and whom else it is told of."""
    with tempfile.TemporaryDirectory(prefix="meshmark-s3-") as folder:
        server = S3(Path(folder), identity(KEYS, "Read", "Write", "List"), *identities)
        server.start()
        try:
            yield server
        finally:
            server.end()


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
