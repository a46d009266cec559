"""Real processes for the tests of the service: API, worker, Redis, each on a free port and in a folder of its own."""

import contextlib
import itertools
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx2
import pytest

from tests.worker.engines import asset
from tests.worker.waiting import PATIENCE, wait_until

EMBEDDED = (
    "import os, sys\n"
    "from service.__main__ import serve\n"
    "from service.config import Settings\n"
    "serve(Settings(), [sys.executable, '-m', 'tests.worker.apps', str(os.getpid())])"
)
EMBEDDED_COMMAND = [sys.executable, "-c", EMBEDDED]
# Before a command: it is told of a hangup also where the tests themselves are not, as after `nohup`.
HEEDING = ["env", "--default-signal=HUP"]
API_COMMAND = [sys.executable, "-m", "service", "api"]
WORKER_COMMAND = [sys.executable, "-m", "celery", "-A", "tests.worker.apps", "worker"]


def free_port() -> int:
    """One below those that the kernel lends to connections: a server that is started again finds it free again.

    Each process of the suite has a share of its own, and gives no port twice before it has given all: what it gave
    may not be listened on yet.
    """
    while True:
        port = next(_ports)
        with contextlib.suppress(OSError), socket.socket() as probe:
            probe.bind(("127.0.0.1", port))
            return port


def _share() -> Iterator[int]:
    number = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    ports = range(10_000, 32_768)[number :: int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))]
    return itertools.cycle(random.sample(ports, len(ports)))


_ports = _share()


@contextmanager
def running(
    command: list[str], environment: dict[str, str], quiet: bool = False
) -> Iterator["subprocess.Popen[bytes]"]:
    """A process that is asked to end afterwards, and must."""
    output = subprocess.DEVNULL if quiet else None
    process = subprocess.Popen(
        command, env=os.environ | environment, start_new_session=True, stdout=output, stderr=output
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        try:
            process.wait(PATIENCE)
        finally:
            process.kill()


@contextmanager
def redis_server(folder: Path, port: int | None = None) -> Iterator[str]:
    """The URL of a Redis of its own."""
    program = shutil.which("redis-server")
    if program is None:
        pytest.fail("redis-server is not installed: apt-get install redis-server", pytrace=False)
    port = port or free_port()
    command = [program, "--port", str(port), "--bind", "127.0.0.1", "--dir", os.fspath(folder), "--save", ""]
    with running([*command, "--loglevel", "warning"], {}, quiet=True):

        def listens() -> bool:
            with socket.socket() as probe:
                return probe.connect_ex(("127.0.0.1", port)) == 0

        wait_until(listens)
        yield f"redis://127.0.0.1:{port}/0"


class Service:
    """A client of a running service, and the environment its processes share."""

    def __init__(self, folder: Path, **settings: str) -> None:
        port = free_port()
        values = {"port": str(port), "data_dir": os.fspath(folder / "data"), "lease_seconds": "5"}
        values |= {"shutdown_seconds": "0", **settings}
        self.environment = {f"MESHMARK_{name.upper()}": value for name, value in values.items()}
        self.url = f"http://127.0.0.1:{port}"

    @contextmanager
    def running(self, *commands: list[str]) -> Iterator["list[subprocess.Popen[bytes]]"]:
        """Start the processes and wait until the API answers."""
        with ExitStack() as stack:
            processes = [stack.enter_context(running(command, self.environment)) for command in commands]
            self.client = stack.enter_context(httpx2.Client(base_url=self.url, timeout=PATIENCE))
            wait_until(self.is_up)
            yield processes

    def is_up(self) -> bool:
        try:
            return self.client.get("/healthz").status_code == 200
        except httpx2.TransportError:
            return False

    def submit(self, content: bytes | None = None, params: str = '{"text": "HI"}', **files: Any) -> httpx2.Response:
        parts = {"file": ("asset.obj", asset() if content is None else content), **files}
        return self.client.post("/v1/watermarks", files=parts, data={"params": params})

    def start_job(self, do: str = "work", **details: Any) -> str:
        """The URL of a job whose engine does what it is told."""
        response = self.submit(asset(do, **details))
        assert response.status_code == 202, response.text
        return response.headers["Location"]

    def job(self, url: str) -> dict[str, Any]:
        response = self.client.get(url)
        assert response.status_code == 200, response.text
        return dict(response.json())

    def wait_for(self, url: str, state: str) -> dict[str, Any]:
        ended = {"succeeded", "failed", "canceled", "expired"}
        wait_until(lambda: self.job(url)["state"] in ended | {state})
        job = self.job(url)
        assert job["state"] == state, job
        return job
