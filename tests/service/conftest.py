import atexit
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest
import structlog
from fastapi.testclient import TestClient

from service.app import create_app
from service.config import Settings
from service.intake import gate_template
from service.jobs import queue
from service.template import Template
from tests.service.edge import Edge, edge_with
from tests.worker.engines import asset
from worker.tasks import Worker


class Client:
    """The application in this process, and a worker that runs jobs when it is told to."""

    def __init__(self, http: TestClient, settings: Settings) -> None:
        self.http = http
        engines = ("tests.worker.engines:directed", "tests.worker.engines:looked_at")
        self.worker = Worker(settings, queue.create_queue(settings), *engines)
        self.artifacts = self.worker.artifacts

    def submit(self, content: bytes | None = None, params: str = '{"text": "HI"}', name: str = "asset.obj") -> str:
        """The URL of a new job."""
        parts = {"file": (name, asset() if content is None else content)}
        response = self.http.post("/v1/watermarks", files=parts, data={"params": params})
        assert response.status_code == 202, response.text
        return response.headers["Location"]

    def run(self, url: str) -> None:
        self.worker.run(url.rsplit("/", 1)[1])


@pytest.fixture(scope="module")
def hasty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Edge]:
    """A server that waits half a second only."""
    with edge_with(data_dir=tmp_path_factory.mktemp("hasty"), client_timeout=0.5) as edge:
        yield edge


@pytest.fixture(autouse=True, scope="session")
def quiet() -> None:
    structlog.configure(processors=[structlog.processors.KeyValueRenderer()])


@cache
def gate() -> Template:
    """What the gate's processes of all applications in this process are forked from; it ends with this process."""
    template = gate_template()
    atexit.register(template.close)
    return template


@contextmanager
def client_with(settings: Settings, template: Template | None = None) -> Iterator[Client]:
    """A running application with these settings, and what the processes of its gate are forked from."""
    with TestClient(
        create_app(settings, template or gate()), raise_server_exceptions=False, follow_redirects=False
    ) as http:
        client = Client(http, settings)
        try:
            yield client
        finally:
            client.worker.close()


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Client]:
    with client_with(Settings(data_dir=tmp_path, max_upload_bytes=100_000, max_font_bytes=50_000)) as client:
        yield client
