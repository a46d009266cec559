"""A real service behind a proxy with faults, both clients of it, and a hand that does the jobs."""

import asyncio
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from sqlalchemy import select

from core.errors import ErrorCode, MeshmarkError
from service.client import AsyncClient, Client, exchange, operations
from service.jobs import contents
from service.jobs.ledger import Ledger
from service.jobs.models import ArtifactKind, Job, JobKind, JobState, Lease
from tests.service.client.proxy import Proxy
from tests.service.edge import Edge, edge_with
from tests.worker.waiting import wait_until

REPORT = {"metrics": {"ocr": 1.0}}
MODEL = bytes(range(256)) * 8192  # 2 MiB


class Hand:
    """Does jobs as a worker would, at once or step by step."""

    def __init__(self, edge: Edge) -> None:
        self.ledger: Ledger = edge.state.ledger
        self.artifacts = edge.state.artifacts

    def queued(self) -> list[str]:
        with self.ledger.sessions() as session:
            return list(session.scalars(select(Job.id).where(Job.state == JobState.QUEUED, ~Job.held)))

    def begin(self, job_id: str, stage: str = "reading") -> Lease:
        job = self.ledger.claim(job_id, 60)
        assert job is not None
        self.stage(job.lease, stage, 0.1)
        return job.lease

    def stage(self, lease: Lease, stage: str, progress: float) -> None:
        assert self.ledger.heartbeat(lease, 60, stage, progress)

    def succeed(self, lease: Lease) -> None:
        with self.ledger.sessions() as session:
            job = session.get_one(Job, lease.job_id)
        files = {ArtifactKind.REPORT: json.dumps(REPORT).encode()}
        if job.kind is JobKind.CONVERSION:
            files = {ArtifactKind.MODEL: MODEL}
        elif job.kind is JobKind.WATERMARK:
            files |= {ArtifactKind.MODEL: MODEL, ArtifactKind.PREVIEW: b"\x89PNG"}
            files |= {} if job.copy_of else {ArtifactKind.PLAN: b"{}"}
        else:
            files |= {ArtifactKind.EVIDENCE: b"<html>"}
        for part, content in files.items():
            with self.artifacts.stage_chunks([content], limit=len(content), name=part) as staged:
                assert contents.publish(self.ledger, self.artifacts, lease, part, staged)
        assert self.ledger.succeed(lease)

    def do(self, job_id: str) -> None:
        """What the job's metadata say: it fails, or succeeds."""
        lease = self.begin(job_id)
        job = self.ledger.get(job_id, "alice")
        assert job is not None
        if any(entry.key == "fail" for entry in job.metadata_entries):
            self.ledger.fail(lease, MeshmarkError(ErrorCode.NO_PLACEMENT, "No place for it.", "Ask for less."))
        else:
            self.stage(lease, "placing", 0.4)
            self.succeed(lease)

    @contextmanager
    def working(self) -> Iterator[None]:
        """Do every job that comes meanwhile."""
        stopping = threading.Event()

        def work() -> None:
            while not stopping.wait(0.02):
                for job_id in self.queued():
                    self.do(job_id)

        thread = threading.Thread(target=work)
        thread.start()
        try:
            yield
        finally:
            stopping.set()
            thread.join()


class Either:
    """One of the two clients, and the way to its results: a result itself, or one that is awaited."""

    def __init__(self, is_async: bool, port: int, key: str) -> None:
        self.url = f"http://127.0.0.1:{port}"
        self._runner = asyncio.Runner() if is_async else None
        self.client: Any = AsyncClient(self.url, key) if is_async else Client(self.url, key)

    def __call__(self, result: Any) -> Any:
        return self._runner.run(result) if self._runner else result

    def all(self, results: Any) -> list[Any]:
        async def listed() -> list[Any]:
            return [result async for result in results]

        return self._runner.run(listed()) if self._runner else list(results)

    def close(self) -> None:
        self(self.client.close())
        if self._runner:
            self._runner.close()


@pytest.fixture(scope="module")
def edge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Edge]:
    with edge_with(data_dir=tmp_path_factory.mktemp("client"), cache=False, source_urls=True) as edge:
        yield edge


@pytest.fixture
def proxy(edge: Edge) -> Iterator[Proxy]:
    proxy = Proxy(edge.port)
    yield proxy
    proxy.close()


@pytest.fixture
def hand(edge: Edge) -> Hand:
    return Hand(edge)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exchange, "FIRST_PAUSE", 0.01)
    monkeypatch.setattr(operations, "FIRST_POLL", 0.01)


@pytest.fixture(params=["sync", "async"])
def either(request: pytest.FixtureRequest, proxy: Proxy, edge: Edge, hand: Hand) -> Iterator[Either]:
    either = Either(request.param == "async", proxy.port, edge.keys[0])
    yield either
    either.close()
    for job_id in hand.queued():  # none is left for the next test
        hand.ledger.cancel(job_id, "alice")


def wait_for_events(edge: Edge) -> None:
    """Until somebody follows a job."""
    wait_until(lambda: edge.state.streams.count("alice"))
