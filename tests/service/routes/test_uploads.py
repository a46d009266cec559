"""Assets sent ahead of the requests that use them, through the service and straight to the bucket."""

import hashlib
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx2
import pytest
from httpx2 import Response
from sqlalchemy import update

from service.config import Settings
from service.jobs import uploads
from service.jobs.artifacts import GRACE
from service.jobs.clock import now
from service.jobs.models import Upload
from tests.service.conftest import Client, client_with
from tests.service.harness import API_COMMAND, Service
from tests.service.s3 import S3, bucket_settings
from tests.worker.engines import asset
from worker.sweeper import sweep_store


@pytest.fixture(params=["folder", "bucket", "presigned"])
def client(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Client]:
    settings = Settings(data_dir=tmp_path, max_upload_bytes=10_000)
    if request.param != "folder":
        s3: S3 = request.getfixturevalue("s3")
        settings = bucket_settings(
            s3.new_bucket(), tmp_path, max_upload_bytes=10_000, s3_presign=request.param == "presigned"
        )
    with client_with(settings) as client:
        yield client


def begin(client: Client, content: bytes = b"", **declared: Any) -> dict[str, Any]:
    answer = client.http.post("/v1/uploads", json={"size": len(content)} | declared)
    assert answer.status_code == 201, answer.text
    return dict(answer.json())


def put(client: Client, upload: dict[str, Any], content: bytes) -> Response:
    """Send it where it is to be sent: to the service, or to the bucket without the service."""
    if upload["url"].startswith("/"):
        return client.http.put(upload["url"], content=content)
    return httpx2.put(upload["url"], content=content)


def use(client: Client, upload: dict[str, Any], text: str = "HI") -> Response:
    return client.http.post("/v1/watermarks", data={"params": f'{{"text": "{text}"}}', "upload_id": upload["id"]})


def refused(answer: Response, status: int, code: str) -> None:
    assert (answer.status_code, answer.json()["code"]) == (status, code), answer.text


def test_what_was_sent_ahead_is_watermarked_as_often_as_it_is_named(client: Client) -> None:
    content = asset()
    digest = hashlib.sha256(content).hexdigest()
    upload = begin(client, content, sha256=digest, filename="shop/lantern.obj")
    assert put(client, upload, content).is_success
    for text in ("HI", "HO"):
        accepted = use(client, upload, text)
        assert accepted.status_code == 202, accepted.text
        client.run(accepted.headers["Location"])
        job = client.http.get(accepted.headers["Location"]).json()
        assert job["state"] == "succeeded"
        assert job["input"] == {"filename": "lantern.obj", "size": len(content), "sha256": digest}
        assert job["parameters"]["text"] == text


def test_an_upload_that_is_cut_off_can_be_sent_again(client: Client) -> None:
    content = asset()
    upload = begin(client, content)
    put(client, upload, content[:-1])
    assert use(client, upload).json()["code"] in ("upload_not_sent", "upload_mismatch")
    assert put(client, upload, content).is_success
    assert use(client, upload).status_code == 202


def test_an_upload_that_was_not_sent_cannot_be_used(client: Client) -> None:
    refused(use(client, begin(client, asset())), 409, "upload_not_sent")
    refused(use(client, {"id": "nothing"}), 404, "not_found")
    refused(use(client, {"id": "\0"}), 404, "not_found")


@pytest.mark.parametrize("wrong", [b"", b"v", b"v" * 5000, b"v" * 5])
def test_what_is_not_what_was_declared_makes_no_job(client: Client, wrong: bytes) -> None:
    content = b"v 0 0"
    upload = begin(client, content, sha256=hashlib.sha256(content).hexdigest())
    sent = put(client, upload, wrong)
    if upload["url"].startswith("/"):
        refused(sent, 422, "upload_mismatch")
        refused(use(client, upload), 409, "upload_not_sent")
    else:
        refused(use(client, upload), 422, "upload_mismatch")
    assert client.http.get("/v1/watermarks").json()["items"] == []
    assert list(client.artifacts.listing()) == []


def test_what_is_no_asset_is_refused_when_it_is_named(client: Client) -> None:
    for content, code, status in ((b"", "empty_file", 422), (b"Dear sir or madam", "unknown_format", 415)):
        upload = begin(client, content)
        assert put(client, upload, content).is_success
        refused(use(client, upload), status, code)


def test_an_upload_larger_than_any_asset_may_be_is_not_begun(client: Client) -> None:
    refused(client.http.post("/v1/uploads", json={"size": 10_001}), 413, "upload_too_large")


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        ({"json": {}}, 400, "invalid_request"),
        ({"json": {"size": -1}}, 400, "invalid_request"),
        ({"json": {"size": 1, "sha256": "abc"}}, 400, "invalid_request"),
        ({"json": {"size": 1, "more": 1}}, 400, "invalid_request"),
        ({"json": [1]}, 400, "invalid_request"),
        ({"content": b"{", "headers": {"Content-Type": "application/json"}}, 400, "invalid_request"),
        ({"data": {"size": "1"}}, 415, "unsupported_media_type"),
        ({}, 415, "unsupported_media_type"),
    ],
)
def test_a_beginning_that_is_none_is_refused(tmp_path: Path, body: dict[str, Any], status: int, code: str) -> None:
    with client_with(Settings(data_dir=tmp_path)) as client:
        refused(client.http.post("/v1/uploads", **body), status, code)


def age(client: Client, upload: dict[str, Any], moment: timedelta) -> None:
    with client.worker.ledger.sessions.begin() as session:
        session.execute(update(Upload).where(Upload.id == upload["id"]).values(expires_at=now() - moment))


def test_an_upload_that_has_expired_is_refused_and_later_removed(client: Client) -> None:
    content = asset()
    upload, fresh = begin(client, content), begin(client, content)
    put(client, upload, content)
    put(client, fresh, content)
    job = use(client, upload).headers["Location"]
    age(client, upload, timedelta())
    sweep_store(client.worker, 0)
    refused(use(client, upload), 410, "upload_expired")
    assert b"".join(client.artifacts.read_upload(upload["id"])) == content, "whoever is reading it may go on"
    refused(client.http.put(f"/v1/uploads/{upload['id']}", content=content), 410, "upload_expired")
    age(client, upload, timedelta(seconds=GRACE + 1))
    sweep_store(client.worker, 0)
    refused(use(client, upload), 404, "not_found")
    with pytest.raises(FileNotFoundError):
        b"".join(client.artifacts.read_upload(upload["id"]))
    assert use(client, fresh).status_code == 202
    client.run(job)
    assert client.http.get(job).json()["state"] == "succeeded", "a job has its input for itself"


def test_a_tenant_who_has_too_many_uploads_begins_no_more(database_url: str, tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, database_url=database_url, max_active_jobs=2)) as client:
        first, _ = begin(client), begin(client)
        answer = client.http.post("/v1/uploads", json={"size": 1})
        refused(answer, 429, "too_many_uploads")
        assert int(answer.headers["Retry-After"]) > 0
        age(client, first, timedelta())
        begin(client)


def test_an_upload_says_until_when_it_is_good(client: Client) -> None:
    upload = begin(client)
    assert upload["method"] == "PUT"
    if upload["url"].startswith("/"):
        assert upload["url_expires_at"] == upload["expires_at"]
    else:
        assert upload["url_expires_at"] < upload["expires_at"]
    assert uploads.LINK_LIFETIME < uploads.LIFETIME


def test_through_a_real_server_an_upload_streams_and_one_over_its_size_is_ended(tmp_path: Path) -> None:
    service = Service(tmp_path)
    sent = 0

    def endless() -> Iterator[bytes]:
        nonlocal sent
        for _ in range(500):
            sent += 1
            yield b"v" * 2**20

    with service.running(API_COMMAND):
        large = service.client.post("/v1/uploads", json={"size": 3 * 2**20}).json()
        assert service.client.put(large["url"], content=b"v" * (3 * 2**20)).status_code == 204
        small = service.client.post("/v1/uploads", json={"size": 5}).json()
        answer = service.client.put(small["url"], content=endless())
        refused(answer, 422, "upload_mismatch")
        assert sent < 100
