from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from httpx2 import Response

from service.app import JSON_BYTES
from service.config import Settings
from service.jobs.events import ENDINGS
from service.routes.webhook_schemas import Event
from service.webhooks.signing import new_secret
from tests.service.conftest import Client, client_with
from tests.worker.engines import asset

PATH = "/v1/webhook-endpoints"
URL = "https://shop.example/hook"


@pytest.fixture
def client(database_url: str, tmp_path: Path) -> Iterator[Client]:
    with client_with(Settings(data_dir=tmp_path, database_url=database_url)) as client:
        yield client


def made(client: Client, url: str | None = URL, **body: Any) -> dict[str, Any]:
    response = client.http.post(PATH, json={"url": url, **body})
    assert response.status_code == 201, response.text
    return dict(response.json())


def submit(client: Client, **form: str) -> Response:
    parts = {"file": ("asset.obj", asset())}
    return client.http.post("/v1/watermarks", files=parts, data={"params": '{"text": "HI"}', **form})


def refused(response: Response, status: int, code: str, says: str = "") -> None:
    assert (response.status_code, response.json()["code"]) == (status, code), response.text
    assert says in response.json()["detail"]


def test_an_endpoint_is_made_read_changed_and_deleted(client: Client) -> None:
    response = client.http.post(PATH, json={"url": URL})
    endpoint = response.json()
    address = response.headers["Location"]
    assert address == f"{PATH}/{endpoint['id']}"
    assert endpoint["secret"].startswith("whsec_")
    assert endpoint["events"] == sorted(event for event in ENDINGS if event.startswith("watermark."))
    assert (endpoint["disabled"], endpoint["disabled_reason"], endpoint["former_secret_until"]) == (False, None, None)
    del endpoint["secret"]
    assert client.http.get(address).json() == endpoint
    assert client.http.get(PATH).json() == {"items": [endpoint]}
    changed = client.http.patch(address, json={"events": ["watermark.failed"], "disabled": True}).json()
    assert changed == endpoint | {"events": ["watermark.failed"], "disabled": True, "disabled_reason": "requested"}
    assert client.http.patch(address, json={}).json() == changed
    assert client.http.patch(address, json={"disabled": False}).json() == changed | {
        "disabled": False,
        "disabled_reason": None,
    }
    assert client.http.delete(address).status_code == 204
    refused(client.http.get(address), 404, "not_found")
    refused(client.http.delete(address), 404, "not_found")


def test_a_rotation_shows_the_new_secret_and_how_long_the_old_one_works(client: Client) -> None:
    endpoint = made(client)
    rotated = client.http.post(f"{PATH}/{endpoint['id']}/rotate-secret")
    assert rotated.status_code == 200
    assert rotated.json()["secret"] not in (None, endpoint["secret"])
    assert rotated.json()["former_secret_until"].endswith("Z")
    mine = new_secret()
    assert client.http.post(f"{PATH}/{endpoint['id']}/rotate-secret", json={"secret": mine}).json()["secret"] == mine
    refused(client.http.post(f"{PATH}/{endpoint['id']}/rotate-secret", json={"secret": "x"}), 422, "invalid_secret")


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ({}, "url"),
        ({"url": 5}, "url"),
        ({"url": URL, "events": []}, "events"),
        ({"url": URL, "events": ["watermark.queued"]}, "events.0"),
        ({"url": URL, "disabled": True}, "disabled"),
        ([], "body"),
        ("x", "body"),
    ],
)
def test_a_body_that_is_not_as_described_is_refused_by_name(client: Client, body: Any, says: str) -> None:
    refused(client.http.post(PATH, json=body), 400, "invalid_request", says)
    assert client.http.get(PATH).json() == {"items": []}


@pytest.mark.parametrize("content", [b"", b"{", b"\xff", b'{"url": "\\ud800"}'])
def test_what_is_no_json_is_refused(client: Client, content: bytes) -> None:
    response = client.http.post(PATH, content=content, headers={"Content-Type": "application/json"})
    assert response.json()["code"] in ("invalid_request", "address_refused")
    form = client.http.post(PATH, content=content, headers={"Content-Type": "text/plain"})
    refused(form, 415, "unsupported_media_type", "text/plain")


def test_a_body_that_is_too_large_is_not_read(client: Client) -> None:
    body = b'{"url": "' + b"x" * JSON_BYTES + b'"}'
    for content in (body, iter([body[:1000], body[1000:]])):  # one that declares its length, and one that does not
        response = client.http.post(PATH, content=content, headers={"Content-Type": "application/json"})
        refused(response, 413, "upload_too_large", f"{JSON_BYTES:,}")


@pytest.mark.parametrize("url", ["http://shop.example/", "https://10.0.0.1/", "https://localhost:1/", "shop"])
def test_a_url_that_is_never_called_is_refused(client: Client, url: str) -> None:
    refused(client.http.post(PATH, json={"url": url}), 422, "address_refused")
    address = f"{PATH}/{made(client)['id']}"
    refused(client.http.patch(address, json={"url": url}), 422, "address_refused")
    made(client, None)
    refused(submit(client, webhook=url), 422, "address_refused")


def test_a_jobs_webhook_needs_an_endpoint_without_a_url_of_which_there_is_one(client: Client) -> None:
    refused(submit(client, webhook=URL), 422, "no_webhook_secret")
    own = made(client, None)
    assert own["url"] is None
    refused(client.http.post(PATH, json={"url": None}), 409, "endpoint_exists")
    job = submit(client, webhook=URL).json()
    assert job["webhook"] == URL
    assert submit(client).json()["webhook"] is None
    client.run(job["links"]["self"])
    [delivery] = client.http.get(f"{PATH}/{own['id']}/deliveries").json()["items"]
    assert (delivery["url"], delivery["job_id"], delivery["type"]) == (URL, job["id"], "watermark.succeeded")


def test_another_webhook_makes_another_request(client: Client) -> None:
    made(client, None)
    parts = {"file": ("asset.obj", asset())}
    answers = [
        client.http.post(
            "/v1/watermarks",
            files=parts,
            data={"params": '{"text": "HI"}', "webhook": url},
            headers={"Idempotency-Key": "1"},
        )
        for url in (URL, URL, URL + "2")
    ]
    assert [answer.status_code for answer in answers] == [202, 202, 422]
    assert answers[0].json()["id"] == answers[1].json()["id"]


def test_the_log_tells_what_is_to_be_sent_and_is_read_page_by_page(client: Client) -> None:
    log = f"{PATH}/{made(client)['id']}/deliveries"
    jobs = [submit(client).json()["id"] for _ in range(3)]
    for job_id in jobs:
        client.http.delete(f"/v1/watermarks/{job_id}")
    first = client.http.get(log, params={"limit": 2, "state": "pending"}).json()
    second = client.http.get(first["next"]).json()
    assert second["next"] is None
    assert [item["job_id"] for item in first["items"] + second["items"]] == jobs[::-1]
    delivery = first["items"][0]
    assert (delivery["type"], delivery["state"], delivery["attempts"]) == ("watermark.canceled", "pending", [])
    assert delivery["webhook_id"] == f"msg_{delivery['job_id'].replace('-', '')}_2"
    assert delivery["next_attempt_at"] == delivery["created_at"]
    again = client.http.post(f"{log}/{delivery['id']}/redeliver")
    assert (again.status_code, again.json()["id"]) == (202, delivery["id"])
    refused(client.http.get(log, params={"cursor": "x"}), 400, "invalid_request")
    refused(client.http.get(log, params={"state": "lost"}), 400, "invalid_request")
    refused(client.http.post(f"{log}/x/redeliver"), 404, "not_found")


def test_the_events_there_are_webhooks_of_are_those_that_end_a_job() -> None:
    assert get_args(Event) == tuple(map(str, ENDINGS))
