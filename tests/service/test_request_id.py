"""One id from the client's request to the lines of the engine's process, in the logs of real processes."""

import json
import os
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from service.request_id import valid_request_id
from tests.service.conftest import Client
from tests.service.harness import API_COMMAND, WORKER_COMMAND, Service, redis_server
from tests.worker.engines import asset
from tests.worker.waiting import wait_until


class Logged:
    """A running service whose lines are kept."""

    def __init__(self, service: Service, file: Path) -> None:
        self.service, self._file = service, file

    def lines(self, **fields: Any) -> list[dict[str, Any]]:
        """Those that have these fields."""
        lines = [json.loads(line) for line in self._file.read_text().splitlines() if line.startswith("{")]
        return [line for line in lines if line.items() >= fields.items()]


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Logged]:
    folder = tmp_path_factory.mktemp("logged")
    file = folder / "log"
    kept = ["sh", "-c", f'exec "$0" "$@" 2>>{file}']
    with redis_server(folder) as broker:
        service = Service(folder, broker_url=broker)
        with service.running([*kept, *API_COMMAND], [*kept, *WORKER_COMMAND]):
            yield Logged(service, file)


def test_the_clients_id_is_in_the_answer_and_in_every_line_about_its_job(logged: Logged) -> None:
    service = logged.service
    files = {"file": ("asset.obj", asset("stumble"))}
    headers = {"X-Request-ID": "order-4711/upload.1"}
    response = service.client.post("/v1/watermarks", files=files, data={"params": '{"text": "HI"}'}, headers=headers)
    assert response.headers["X-Request-ID"] == "order-4711/upload.1"
    job = response.json()["id"]
    service.wait_for(response.headers["Location"], "failed")
    both = {"request": "order-4711/upload.1", "job": job}
    wait_until(lambda: logged.lines(event="job failed", **both))
    (accepted,) = logged.lines(event="job accepted", **both)
    assert accepted["logger"].startswith("service")
    (started,) = logged.lines(event="job started", **both)
    assert started["attempt"] == 1
    (engine,) = logged.lines(event="the engine's process wrote to stderr", **both)
    assert "secret detail of the implementation" in engine["text"]
    (answered,) = logged.lines(event="request answered", request="order-4711/upload.1")
    assert (answered["method"], answered["path"], answered["status"]) == ("POST", "/v1/watermarks", 202)
    assert answered["seconds"] > 0
    assert not [line for line in logged.lines(job=job) if line.get("request") != "order-4711/upload.1"]


def test_a_request_without_an_id_or_with_one_that_could_forge_lines_gets_its_own(logged: Logged) -> None:
    drawn = set()
    for headers in (
        {},
        {"X-Request-ID": ""},
        {"X-Request-ID": "a b"},
        {"X-Request-ID": '"}{"'},
        {"X-Request-ID": "x" * 129},
    ):
        response = logged.service.client.get("/v1/watermarks", headers=headers)
        drawn.add(str(uuid.UUID(response.headers["X-Request-ID"])))
    assert len(drawn) == 5
    wait_until(lambda: all(logged.lines(request=identity, path="/v1/watermarks") for identity in drawn))


def test_a_refusal_and_an_unexpected_error_have_the_id_too(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    assert client.http.get("/nothing", headers={"X-Request-ID": "a"}).headers["X-Request-ID"] == "a"
    folder = client.worker.settings.data_dir / "artifacts"
    monkeypatch.setattr(os, "fsync", None)
    files = {"file": ("asset.obj", asset())}
    response = client.http.post(
        "/v1/watermarks", files=files, data={"params": '{"text": "HI"}'}, headers={"X-Request-ID": "b"}
    )
    assert folder.exists()
    assert (response.status_code, response.json()["code"]) == (500, "internal_error")
    assert response.headers["X-Request-ID"] == "b"


def test_ids_that_came_with_a_message_are_checked_again() -> None:
    assert valid_request_id("9f-1_2.3:@+/=") == "9f-1_2.3:@+/="
    for text in (None, 7, "", "a\n", "a\nb", "é", ["a"], "x" * 129):
        assert valid_request_id(text) is None
