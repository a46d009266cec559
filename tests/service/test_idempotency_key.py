"""Requests that are sent again, over HTTP and on both databases."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from httpx2 import Response

from core.artwork.fonts import DEFAULT_FONT
from core.errors import MeshmarkError
from service.config import Settings
from service.idempotency_key import parse_idempotency_key
from service.jobs import queue
from service.jobs.idempotency import fingerprint, reserve
from service.jobs.listing import Filters, list_jobs
from service.jobs.models import Priority, Queue
from tests.service.conftest import Client, client_with
from tests.service.s3 import S3, Flaky, bucket_settings
from tests.worker.engines import asset


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path, database_url=database_url)


@pytest.fixture
def client(settings: Settings) -> Iterator[Client]:
    with client_with(settings) as client:
        yield client


def send(
    client: Client, key: str = "a", content: bytes | None = None, font: bytes | None = None, **data: str
) -> Response:
    files = {"file": ("asset.obj", asset() if content is None else content)}
    if font is not None:
        files["font"] = ("font.ttf", font)
    return client.http.post(
        "/v1/watermarks", files=files, data={"params": '{"text": "HI"}'} | data, headers={"Idempotency-Key": key}
    )


def jobs(client: Client) -> list[str]:
    return [job.id for job in list_jobs(client.worker.ledger.sessions, "default", Filters(), 100).jobs]


def test_a_request_sent_again_is_answered_with_the_same_job(client: Client) -> None:
    first = send(client)
    client.run(first.headers["Location"])
    again = send(client, params='{ "seed": 0, "text": "HI" }')  # the same, in other words
    assert (first.status_code, again.status_code) == (202, 202)
    assert again.headers["Location"] == first.headers["Location"]
    assert (first.headers.get("Idempotent-Replayed"), again.headers["Idempotent-Replayed"]) == (None, "true")
    assert again.json()["state"] == "succeeded"
    assert jobs(client) == [first.json()["id"]]
    assert queue.depth(client.worker.celery, Queue.SMALL) == 1


def test_without_a_key_each_request_is_a_job(client: Client) -> None:
    assert client.submit() != client.submit()


def test_another_request_with_the_key_is_refused(client: Client) -> None:
    first = send(client).json()["id"]
    others = [
        send(client, content=asset("other")),
        send(client, params='{"text": "HO"}'),
        send(client, font=DEFAULT_FONT.read_bytes()),
        send(client, metadata='{"order": "1"}'),
    ]
    for response in others:
        assert (response.status_code, response.json()["code"]) == (422, "idempotency_key_reused")
    assert jobs(client) == [first]


def test_while_a_request_is_answered_its_key_is_in_use(client: Client) -> None:
    """Another process has the key: it reserved it for the very content that is sent here."""
    sample = send(client, "sample").json()
    content = {"parameters": sample["parameters"], "metadata": {}, "priority": Priority.NORMAL}
    content["input"] = sample["input"]["sha256"]
    reserve(client.worker.ledger.sessions, "default", "a", fingerprint(content))
    response = send(client)
    assert (response.status_code, response.json()["code"]) == (409, "idempotency_key_in_use")
    assert int(response.headers["Retry-After"]) >= 1
    assert jobs(client) == [sample["id"]]


def test_many_simultaneous_requests_with_one_key_make_one_job(client: Client, settings: Settings) -> None:
    with client_with(settings) as other, ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda number: send((client, other)[number % 2]), range(16)))
    assert {answer.status_code for answer in answers} <= {202, 409}
    accepted = [answer for answer in answers if answer.status_code == 202]
    assert {answer.json()["id"] for answer in accepted} == set(jobs(client))
    assert len(jobs(client)) == 1
    assert sum("Idempotent-Replayed" not in answer.headers for answer in accepted) == 1
    assert send(client).headers["Idempotent-Replayed"] == "true"


def test_a_request_that_was_refused_does_not_burn_its_key(client: Client) -> None:
    assert send(client, content=b"no asset").status_code == 415
    assert send(client, params='{"text": ""}').status_code == 422
    assert send(client, font=b"no font").status_code == 422
    assert send(client).status_code == 202


def test_a_request_that_the_store_could_not_take_does_not_burn_its_key(
    s3: S3, database_url: str, tmp_path: Path
) -> None:
    with Flaky(s3.url).running() as flaky:
        bucket = s3.new_bucket()
        bucket.endpoint = flaky.url
        settings = bucket_settings(bucket, tmp_path).model_copy(update={"database_url": database_url})
        with client_with(settings) as client:
            flaky.failing.set()
            assert send(client).status_code == 503
            flaky.failing.clear()
            accepted = send(client)
            assert accepted.status_code == 202
            assert "Idempotent-Replayed" not in accepted.headers
            assert len(jobs(client)) == 1


def test_a_key_may_stand_in_quotes_or_not() -> None:
    assert parse_idempotency_key('"8e03978e-40d5"') == "8e03978e-40d5" == parse_idempotency_key("8e03978e-40d5")
    assert parse_idempotency_key(r'"a \"b\" \\"') == r'a "b" \\'[:-1]
    assert parse_idempotency_key("x" * 255) == "x" * 255


@pytest.mark.parametrize("header", ["", '""', '"', 'a"b', "a b", '"a\\b"', "ä", "x" * 256, '"a"; b=1', "a\tb"])
def test_a_key_that_is_none_is_refused(header: str) -> None:
    with pytest.raises(MeshmarkError, match="invalid_request"):
        parse_idempotency_key(header)


def test_a_key_that_is_none_is_refused_over_http(client: Client) -> None:
    response = send(client, "a b")
    assert (response.status_code, response.json()["code"]) == (400, "invalid_request")
    assert jobs(client) == []
