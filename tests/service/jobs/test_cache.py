"""The same asset sent again, over HTTP."""

import json
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import update

from core.artwork.fonts import DEFAULT_FONT
from service.config import Settings
from service.jobs import cache, queue
from service.jobs.ledger import Content
from service.jobs.models import ArtifactKind, Job, Queue
from service.jobs.tenants import Scope, create_key
from tests.core.artwork.fontsmith import SQUARE, make_font
from tests.service.conftest import Client, client_with
from tests.worker.engines import asset


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path, cache=True)


@pytest.fixture
def client(settings: Settings) -> Iterator[Client]:
    with client_with(settings) as client:
        yield client


@pytest.fixture
def on_both(settings: Settings, database_url: str) -> Iterator[Client]:
    """A client of the service on each database."""
    with client_with(settings.model_copy(update={"database_url": database_url})) as client:
        yield client


def send(client: Client, content: bytes | None = None, query: str = "", **more: Any) -> dict[str, Any]:
    files = {"file": ("asset.obj", asset() if content is None else content)} | more.pop("files", {})
    data = {"params": json.dumps({"text": "HI"} | more.pop("params", {}))}
    answer = client.http.post(f"/v1/watermarks{query}", files=files, data=data, **more)
    assert answer.status_code == 202, answer.text
    return dict(answer.json())


def done(client: Client, **request: Any) -> dict[str, Any]:
    """A job that was worked on."""
    url = send(client, **request)["links"]["self"]
    client.run(url)
    job = dict(client.http.get(url).json())
    assert (job["state"], job["cached"], job["attempts"]) == ("succeeded", False, 1)
    return job


def test_the_same_again_has_succeeded_at_once_with_the_same_results(on_both: Client) -> None:
    first = done(on_both)
    waiting = queue.depth(on_both.worker.celery, Queue.SMALL)
    again = send(on_both)
    assert (again["state"], again["cached"], again["attempts"], again["progress"]) == ("succeeded", True, 0, 1)
    assert again["id"] != first["id"]
    assert again["input"] == first["input"]
    for part in ("model", "report", "preview"):
        old, new = (on_both.http.get(job["links"][part]) for job in (first, again))
        assert (new.content, new.headers["ETag"]) == (old.content, old.headers["ETag"])
    assert queue.depth(on_both.worker.celery, Queue.SMALL) == waiting, "no worker is told"
    assert send(on_both)["cached"] is True


def test_it_is_told_that_a_job_has_succeeded_at_once(client: Client) -> None:
    """By an event, as of any job that ends; webhooks go by the same."""
    done(client)
    again = send(client)
    stream = client.http.get(f"{again['links']['self']}/events").text
    assert [line for line in stream.splitlines() if line.startswith("event:")] == ["event: watermark.succeeded"]


def test_each_job_keeps_its_files_when_the_other_is_deleted(on_both: Client) -> None:
    first = done(on_both)
    again = send(on_both)
    on_both.http.delete(first["links"]["self"])
    assert on_both.http.get(again["links"]["model"]).content == b"glTF of HI"
    third = send(on_both)
    assert third["cached"] is True
    for job in (again, third):
        on_both.http.delete(job["links"]["self"])
    assert list(on_both.artifacts.listing()) == []
    assert send(on_both)["state"] == "queued"


def test_what_differs_in_anything_is_worked_on(client: Client) -> None:
    done(client)
    others = [
        send(client, asset(other=1)),
        send(client, params={"text": "HO"}),
        send(client, params={"seed": 1}),
        send(client, files={"font": ("font.ttf", DEFAULT_FONT.read_bytes())}),
        send(client, query="?cache=false"),
    ]
    assert [(job["state"], job["cached"]) for job in others] == [("queued", False)] * 5


def test_parameters_are_the_same_in_other_words(client: Client) -> None:
    done(client)
    assert send(client, params={"seed": 0, "color": None})["cached"] is True


def test_what_has_not_succeeded_is_no_result(client: Client) -> None:
    send(client)
    assert send(client)["state"] == "queued", "the first one still waits"
    refused = asset("refuse")
    client.run(send(client, refused)["links"]["self"])
    assert send(client, refused)["state"] == "queued"


def test_results_that_have_expired_are_none(client: Client) -> None:
    job = done(client)
    with client.worker.ledger.sessions.begin() as session:
        moment = datetime.fromisoformat(job["created_at"])
        session.execute(update(Job).where(Job.id == job["id"]).values(expires_at=moment))
    assert send(client)["state"] == "queued"


def test_a_cached_job_expires_by_its_own_time(settings: Settings) -> None:
    with client_with(settings.model_copy(update={"retention_seconds": 100.0})) as client:
        first, again = done(client), send(client)
        assert first["expires_at"] < again["expires_at"]
        lifetime = datetime.fromisoformat(again["expires_at"]) - datetime.fromisoformat(again["finished_at"])
        assert lifetime.total_seconds() == 100


def test_results_in_other_fonts_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    contents = {ArtifactKind.INPUT: Content("0" * 64, 1)}

    def keys() -> list[str | None]:
        return [cache.result_key({"text": text, "language": None}, contents) for text in ("mark", "\u0e44\u0e17")]

    latin, thai = keys()
    (tmp_path / "NotoSansThai-Bold.ttf").write_bytes(make_font({"\u0e44": [SQUARE], "\u0e17": [SQUARE]}))
    monkeypatch.setenv("MESHMARK_FONTS", str(tmp_path))
    assert keys()[0] == latin
    assert keys()[1] not in (latin, thai)


def test_results_of_another_version_are_none(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    done(client)
    monkeypatch.setattr(cache, "__version__", "0.0.0")
    assert send(client)["state"] == "queued"


def test_no_tenant_is_answered_with_anothers_results(settings: Settings) -> None:
    with client_with(settings.model_copy(update={"auth": "keys"})) as client:
        sessions = client.worker.ledger.sessions
        ours, theirs = (
            {"Authorization": f"Bearer {create_key(sessions, tenant, 'a key', Scope).text}"}
            for tenant in ("acme", "beta")
        )
        client.run(send(client, headers=ours)["links"]["self"])
        assert send(client, headers=theirs)["state"] == "queued"
        assert send(client, headers=ours)["cached"] is True


def test_the_operator_can_turn_it_off(settings: Settings) -> None:
    with client_with(settings.model_copy(update={"cache": False})) as client:
        done(client)
        assert send(client, query="?cache=true")["state"] == "queued"


def test_results_whose_content_vanished_are_made_again(client: Client) -> None:
    job = done(client)
    model = client.http.get(job["links"]["model"]).headers["ETag"].strip('"')
    client.artifacts.remove(model)
    again = send(client)
    assert (again["state"], again["cached"]) == ("queued", False)
    client.run(again["links"]["self"])
    assert client.http.get(f"{again['links']['self']}/model").content == b"glTF of HI"


def test_a_request_sent_again_with_its_key_is_the_first_job(client: Client) -> None:
    done(client)
    first, again = (send(client, headers={"Idempotency-Key": "a"}) for _ in range(2))
    assert first["cached"] is True
    assert again == first
