"""Event streams over a real uvicorn, read as an EventSource reads them, while the ledger moves the job on."""

import json
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import httpx2
import pytest

from service import event_stream
from service.app import create_app
from service.config import Settings
from service.event_stream import Streams
from service.http_server import Server
from service.jobs.ledger import Ledger
from service.jobs.models import Lease
from service.template import Template
from tests.service.conftest import gate
from tests.service.harness import API_COMMAND, Service, free_port
from tests.worker.engines import asset
from tests.worker.waiting import PATIENCE, wait_until


class Event(NamedTuple):
    id: str
    type: str
    data: dict[str, Any]


class Api:
    """A server in this process, a client of it, and its ledger."""

    def __init__(self, settings: Settings, template: Template) -> None:
        app = create_app(settings, template)
        self.server = Server(app, settings)
        self.thread = threading.Thread(target=self.server.run)
        self.thread.start()
        wait_until(lambda: self.server.started)
        self.streams: Streams = app.state.meshmark.streams
        self.ledger: Ledger = app.state.meshmark.ledger
        self.client = httpx2.Client(base_url=f"http://127.0.0.1:{settings.port}", timeout=PATIENCE)

    def submit(self) -> str:
        parts = {"file": ("asset.obj", asset())}
        response = self.client.post(
            "/v1/watermarks", files=parts, data={"params": '{"text": "HI"}', "metadata": '{"order": "4711"}'}
        )
        assert response.status_code == 202, response.text
        return str(response.json()["id"])

    def run(self, job_id: str) -> Lease:
        job = self.ledger.claim(job_id, 60)
        assert job is not None
        self.ledger.heartbeat(job.lease, 60, "reading", 0.0)
        return job.lease

    def close(self) -> None:
        self.server.should_exit = True
        self.thread.join(PATIENCE)
        assert not self.thread.is_alive()
        self.client.close()


@pytest.fixture
def api(tmp_path: Path) -> Iterator[Api]:
    api = Api(Settings(data_dir=tmp_path, port=free_port()), gate())
    yield api
    api.close()


@contextmanager
def listening(client: httpx2.Client, job_id: str, last: str | None = None) -> Iterator[Iterator[Event]]:
    headers = {} if last is None else {"Last-Event-ID": last}
    with client.stream("GET", f"/v1/watermarks/{job_id}/events", headers=headers) as response:
        assert response.status_code == 200
        assert response.headers["Content-Type"].startswith("text/event-stream")
        yield parsed(response.iter_lines())


def parsed(lines: Iterator[str]) -> Iterator[Event]:
    """WHATWG HTML, "Interpreting an event stream", as far as it is used."""
    fields: dict[str, str] = {}
    for line in lines:
        if not line and "data" in fields:
            yield Event(fields["id"], fields["event"], json.loads(fields["data"]))
        if not line:
            fields = {}
        elif not line.startswith(":"):
            name, _, value = line.partition(": ")
            fields[name] = value


def test_a_job_is_followed_from_its_queue_to_its_end(api: Api) -> None:
    job_id = api.submit()
    with listening(api.client, job_id) as events:
        first = next(events)
        assert (first.id, first.type, first.data["state"]) == ("1", "watermark.queued", "queued")
        assert first.data["metadata"] == {"order": "4711"}
        lease = api.run(job_id)
        assert [next(events).type for _ in range(2)] == ["watermark.running", "watermark.stage"]
        api.ledger.succeed(lease)
        [last] = events
    assert (last.id, last.type, last.data["state"], last.data["progress"]) == (
        "4",
        "watermark.succeeded",
        "succeeded",
        1,
    )


def test_who_comes_back_gets_what_came_meanwhile_and_nothing_again(api: Api) -> None:
    job_id = api.submit()
    lease = api.run(job_id)
    with listening(api.client, job_id) as events:
        seen = [next(events), next(events)]
    api.ledger.heartbeat(lease, 60, "placing", 0.5)
    with listening(api.client, job_id, seen[-1].id) as events:
        seen += [next(events), next(events)]
    api.ledger.succeed(lease)
    with listening(api.client, job_id, seen[-1].id) as events:
        seen += events
    assert [event.id for event in seen] == ["1", "2", "3", "4", "5"]
    with listening(api.client, job_id) as events:
        assert list(events) == seen


def test_who_knows_how_it_ended_is_told_not_to_come_back(api: Api) -> None:
    job_id = api.submit()
    api.client.delete(f"/v1/watermarks/{job_id}")
    with listening(api.client, job_id) as events:
        last = [*events][-1]
    assert last.type == "watermark.canceled"
    for known in (last.id, "99"):
        answer = api.client.get(f"/v1/watermarks/{job_id}/events", headers={"Last-Event-ID": known})
        assert (answer.status_code, answer.content) == (204, b"")


def test_an_unknown_job_and_an_unknown_event_are_refused(api: Api) -> None:
    answer = api.client.get(f"/v1/watermarks/{'0' * 36}/events")
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
    answer = api.client.get(f"/v1/watermarks/{api.submit()}/events", headers={"Last-Event-ID": "last"})
    assert (answer.status_code, answer.json()["code"]) == (400, "invalid_request")
    assert api.streams.count("default") == 0


def test_the_line_is_kept_alive(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_stream, "PING", 0.1)
    with api.client.stream("GET", f"/v1/watermarks/{api.submit()}/events") as response:
        assert response.headers["Cache-Control"] == "no-store"
        assert ": ping" in response.iter_lines()


def test_more_streams_than_a_tenant_may_have_are_refused_until_one_is_closed(
    api: Api, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_stream, "STREAMS_PER_TENANT", 2)
    job_id = api.submit()
    with listening(api.client, job_id) as one, listening(api.client, job_id) as other:
        assert next(one) == next(other)
        refused = api.client.get(f"/v1/watermarks/{job_id}/events")
        assert (refused.status_code, refused.json()["code"]) == (429, "too_many_streams")
        assert refused.headers["Retry-After"]
        assert api.client.get(f"/v1/watermarks/{job_id}").status_code == 200
    wait_until(lambda: api.streams.count("default") == 0)
    with listening(api.client, job_id) as events:
        assert next(events).id == "1"


def test_a_server_that_stops_ends_its_streams_in_good_order(api: Api) -> None:
    with listening(api.client, api.submit()) as events:
        assert next(events).id == "1"
        api.server.should_exit = True
        assert list(events) == []
        api.thread.join(PATIENCE)
    assert not api.thread.is_alive()


def test_a_service_told_to_end_does_so_though_streams_are_open(tmp_path: Path) -> None:
    service = Service(tmp_path)
    with service.running(API_COMMAND) as [process]:
        job_id = service.start_job().rsplit("/", 1)[1]
        with listening(service.client, job_id) as events:
            assert next(events).id == "1"
            process.send_signal(signal.SIGTERM)
            assert list(events) == []
            assert process.wait(PATIENCE) == 0
