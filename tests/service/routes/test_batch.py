"""Many jobs in one request: each is accepted or refused by itself."""

from pathlib import Path
from typing import Any

import pytest
from httpx2 import Response

from service.config import Settings
from service.jobs import queue
from service.jobs.models import Queue
from service.jobs.tenants import Scope, create_key
from tests.service.conftest import Client, client_with
from tests.service.outbound.servers import replying, response, serving
from tests.service.s3 import S3, Flaky, bucket_settings
from tests.service.test_source_url import address, client_of
from tests.worker.engines import asset


def upload(client: Client, content: bytes | None = None, **headers: str) -> str:
    content = asset() if content is None else content
    begun = client.http.post("/v1/uploads", json={"size": len(content)}, headers=headers).json()
    assert client.http.put(begun["url"], content=content, headers=headers).status_code == 204
    return str(begun["id"])


def item(upload_id: str, text: str = "HI", **more: Any) -> dict[str, Any]:
    return {"upload_id": upload_id, "parameters": {"text": text}, **more}


def send(client: Client, *items: dict[str, Any], **headers: str) -> list[dict[str, Any]]:
    answer = client.http.post("/v1/watermarks/batch", json={"items": items}, headers=headers)
    assert answer.status_code == 207, answer.text
    return list(answer.json()["items"])


def outcome(result: dict[str, Any]) -> tuple[int, str | None]:
    return result["status"], result["problem"] and result["problem"]["code"]


def test_each_item_is_a_job_of_its_own(client: Client) -> None:
    name = upload(client)
    texts = ["ONE", "TWO", "THREE"]
    results = send(client, *(item(name, text, metadata={"order": text}) for text in texts))
    assert [outcome(result) for result in results] == [(202, None)] * 3
    assert queue.depth(client.worker.celery, Queue.SMALL) == 3
    for text, result in zip(texts, results, strict=True):
        url = result["job"]["links"]["self"]
        client.run(url)
        job = client.http.get(url).json()
        assert (job["state"], job["parameters"]["text"], job["metadata"]) == ("succeeded", text, {"order": text})


def test_an_item_has_copies_of_its_own(client: Client) -> None:
    name, copies = upload(client), [{"text": "ORDER-1", "metadata": {"customer": "1"}}, {"text": "ORDER-2"}]
    results = send(client, item(name, copies=copies), item(name, "TWO", copies=[{"text": "A"}, {"text": "A"}]))
    assert [outcome(result) for result in results] == [(202, None), (422, "invalid_parameters")]
    url = results[0]["job"]["links"]["self"]
    client.run(url)
    made = client.http.get(f"{url}/copies").json()["items"]
    assert [(copy["text"], copy["state"]) for copy in made] == [("ORDER-1", "succeeded"), ("ORDER-2", "succeeded")]
    assert made[0]["metadata"] == {"customer": "1"}


def test_an_item_names_its_own_webhook(client: Client) -> None:
    name, hook = upload(client), "https://shop.example/hooks/4711"
    assert outcome(send(client, item(name, webhook=hook))[0]) == (422, "no_webhook_secret")
    client.http.post("/v1/webhook-endpoints", json={"url": None})
    results = send(client, item(name, webhook=hook, idempotency_key="1"), item(name, webhook="shop"), item(name))
    assert [outcome(result) for result in results] == [(202, None), (422, "address_refused"), (202, None)]
    assert [result["job"]["webhook"] for result in results if result["job"]] == [hook, None]
    assert outcome(send(client, item(name, idempotency_key="1"))[0]) == (422, "idempotency_key_reused")


def test_what_is_wrong_with_one_item_stops_no_other(client: Client) -> None:
    good, letter = upload(client), upload(client, b"Dear sir or madam")
    results = send(
        client,
        item("nothing"),
        item(letter),
        item(good),
        item(good, ""),
        {"upload_id": good, "parameters": {"text": "HI", "size": -1}},
        item(good, metadata={"order": 4711}),
        item(good, idempotency_key="a b"),
        {"parameters": {"text": "HI"}},
        item(good, source_url="https://files.example/a.glb"),
        {"source_url": "https://files.example/a.glb", "parameters": {"text": "HI"}},
    )
    assert [outcome(result) for result in results] == [
        (404, "not_found"),
        (415, "unknown_format"),
        (202, None),
        (422, "empty_text"),
        (422, "invalid_parameters"),
        (422, "invalid_metadata"),
        (400, "invalid_request"),
        (422, "missing_file"),
        (400, "invalid_request"),
        (422, "source_url_disabled"),
    ]
    assert results[0]["job"] is None
    assert set(results[0]["problem"]) == {"type", "title", "status", "detail", "code", "remedy"}
    assert len(client.http.get("/v1/watermarks").json()["items"]) == 1


@pytest.mark.parametrize(
    "asked",
    [{"text": "HI", "logo": "<svg/>"}, {"text": "HI", "logo_position": "above"}],
    ids=["a logo among the parameters", "the place of a logo"],
)
def test_an_item_that_wants_a_logo_is_told_that_a_batch_has_none(client: Client, asked: dict[str, Any]) -> None:
    [result] = send(client, {"upload_id": upload(client), "parameters": asked})
    assert outcome(result) == (422, "invalid_parameters")
    assert "logo" in result["problem"]["detail"]
    assert "a batch and an upload hook take none: use `qr`" in result["problem"]["remedy"]


def test_a_batch_of_qr_codes_beside_texts_refuses_those_that_could_not_be_read(client: Client) -> None:
    name, code = upload(client), {"text": "HI", "qr": "https://a.example"}
    sizes = (None, 2.0, 5.0)
    results = send(client, *({"upload_id": name, "parameters": code | {"size": size}} for size in sizes))
    assert [outcome(result) for result in results] == [(202, None), (422, "invalid_parameters"), (202, None)]
    assert "`size` of 2." in results[1]["problem"]["detail"]


def test_a_batch_sent_again_makes_no_job_twice(client: Client) -> None:
    name = upload(client)
    items = [item(name, text, idempotency_key=text) for text in ("ONE", "TWO")]
    first, again = send(client, *items), send(client, *items, item(name, "THREE", idempotency_key="ONE"))
    assert [result["replayed"] for result in first + again] == [False, False, True, True, False]
    assert [result["job"]["id"] for result in again[:2]] == [result["job"]["id"] for result in first]
    assert outcome(again[2]) == (422, "idempotency_key_reused")
    assert queue.depth(client.worker.celery, Queue.SMALL) == 2


def test_assets_may_be_at_addresses(tmp_path: Path) -> None:
    with serving(replying(response(asset()))) as server, client_of(server, tmp_path) as client:
        [result] = send(client, {"source_url": address(server), "parameters": {"text": "HI"}})
        client.run(result["job"]["links"]["self"])
        assert client.http.get(result["job"]["links"]["self"]).json()["state"] == "succeeded"


def test_the_limit_of_jobs_counts_each_item(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, max_active_jobs=2)) as client:
        name = upload(client)
        results = send(client, *(item(name, text) for text in ("ONE", "TWO", "THREE")))
        assert [outcome(result) for result in results] == [(202, None), (202, None), (429, "too_many_jobs")]


def test_the_limit_of_requests_counts_each_item(database_url: str, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, database_url=database_url, auth="keys", requests_per_minute=5)
    with client_with(settings) as client:
        key = create_key(client.worker.ledger.sessions, "acme", "a key", Scope)
        bearer = {"Authorization": f"Bearer {key.text}"}
        name = upload(client, None, **bearer)  # two requests
        results = send(client, *(item(name) for _ in range(5)), **bearer)
        assert [result["status"] for result in results] == [202, 202, 202, 429, 429]
        assert results[3]["problem"]["code"] == "rate_limited"


def test_a_store_that_fails_refuses_the_items_and_not_the_request(s3: S3, tmp_path: Path) -> None:
    with Flaky(s3.url).running() as flaky:
        bucket = s3.new_bucket()
        bucket.endpoint = flaky.url
        with client_with(bucket_settings(bucket, tmp_path)) as client:
            name = upload(client)
            flaky.failing.set()
            assert [outcome(result) for result in send(client, item(name))] == [(503, "service_unavailable")]
            flaky.failing.clear()
            assert [outcome(result) for result in send(client, item(name))] == [(202, None)]


def refused(answer: Response, status: int, code: str) -> None:
    assert (answer.status_code, answer.json()["code"]) == (status, code), answer.text
    assert answer.headers["Content-Type"] == "application/problem+json"


@pytest.mark.parametrize(
    "body", [{}, {"items": []}, {"items": [{}]}, {"items": [item("a", other=1)]}, {"items": [item("a")] * 101}, [1]]
)
def test_a_batch_of_another_form_is_refused_as_a_whole(client: Client, body: Any) -> None:
    refused(client.http.post("/v1/watermarks/batch", json=body), 400, "invalid_request")


def test_a_batch_that_is_no_json_or_too_large_is_refused(client: Client) -> None:
    refused(client.http.post("/v1/watermarks/batch", data={"items": "1"}), 415, "unsupported_media_type")
    large = b'{"items": [' + b" " * 2**20 + b"]}"
    headers = {"Content-Type": "application/json"}
    refused(client.http.post("/v1/watermarks/batch", content=large, headers=headers), 413, "upload_too_large")
    streamed = client.http.post("/v1/watermarks/batch", content=iter([large]), headers=headers)
    refused(streamed, 413, "upload_too_large")
    assert f"{2**20:,}" in streamed.json()["detail"]
