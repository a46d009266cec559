"""Verifications over HTTP: with keys and without, and what is kept of the files."""

import io
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from httpx2 import Response
from PIL import Image
from sqlalchemy import select, update

from service.config import Settings
from service.jobs.clock import now
from service.jobs.dead import WORKER_LOST
from service.jobs.models import PUBLIC_TENANT, ArtifactKind, Job, Lease
from service.jobs.tenants import Scope, create_key
from tests.core.metrics.drawn import drawn
from tests.service.conftest import Client, client_with
from tests.service.routes.test_watermarks import HUGE_ACCESSOR, glb, refused
from tests.worker.engines import asset
from worker.sweeper import remove_expired

PLACE = "/v1/verifications"
HUGE = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sIIBBBBBI", 13, b"IHDR", 10_000, 10_000, 8, 2, 0, 0, 0, 0)


def png(picture: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "PNG")
    return file.getvalue()


def post(client: Client, content: bytes | None = None, params: str = '{"texts": ["HI"]}', **more: Any) -> Response:
    parts = {"file": ("suspect.obj", asset() if content is None else content), **more.pop("files", {})}
    data = {"params": params, **more.pop("data", {})}
    return client.http.post(PLACE, files=parts, data=data, **more)


def sent(client: Client, *arguments: Any, **named: Any) -> str:
    response = post(client, *arguments, **named)
    assert response.status_code == 202, response.text
    return str(response.headers["Location"])


def stored(client: Client) -> int:
    return len(list(client.artifacts.listing()))


def test_a_suspect_file_becomes_a_report_and_a_page_of_evidence_and_is_gone(client: Client) -> None:
    response = post(client, data={"metadata": '{"listing": "0815"}'})
    job = response.json()
    place = response.headers["Location"]
    assert place == f"{PLACE}/{job['id']}" == job["links"]["self"]
    assert (job["state"], job["input"]["filename"]) == ("queued", "suspect.obj")
    assert job["parameters"] == {"texts": ["HI"], "watermark": None, "keep": False}
    assert client.http.get(place).json() == job
    client.run(place)
    done = client.http.get(place).json()
    assert (done["state"], done["input"], done["metadata"]) == ("succeeded", None, {"listing": "0815"})
    assert done["links"] == {name: f"{place}/{name}" for name in ("events", "report", "evidence")} | {"self": place}
    report = client.http.get(done["links"]["report"])
    assert report.headers["Content-Type"] == "application/json"
    assert report.json()["schema"] == "meshmark.verification/1"
    assert (report.json()["found"], report.json()["file"]["sha256"]) == (["HI"], job["input"]["sha256"])
    assert stored(client) == 2


def test_the_page_of_evidence_can_do_nothing_in_a_browser(client: Client) -> None:
    place = sent(client)
    client.run(place)
    for answer in (client.http.get(f"{place}/evidence"), client.http.head(f"{place}/evidence")):
        assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
        policy = answer.headers["Content-Security-Policy"]
        assert policy == "default-src 'none'; img-src data:; style-src 'unsafe-inline'; sandbox"
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Content-Disposition"] == 'inline; filename="suspect.evidence.html"'
    page = client.http.get(f"{place}/evidence").text
    assert "suspect.obj" in page
    started = client.http.get(place).json()["started_at"]
    assert started[:10] in page


def test_a_file_is_kept_where_that_is_asked_for_and_deleted_with_the_job(client: Client) -> None:
    place = sent(client, params='{"keep": true}')
    client.run(place)
    assert client.http.get(place).json()["input"]["size"] == len(asset())
    assert stored(client) == 3
    assert client.http.delete(place).status_code == 204
    assert stored(client) == 0
    assert client.http.get(place).json()["parameters"] is None


@pytest.mark.parametrize("end", ["refuse", "delete"])
def test_a_file_that_is_not_kept_is_gone_however_the_job_ends(client: Client, end: str) -> None:
    place = sent(client, asset("refuse"))
    assert stored(client) == 1
    if end == "delete":
        assert client.http.delete(place).status_code == 204
    else:
        client.run(place)
    job = client.http.get(place).json()
    assert job["state"] == {"refuse": "failed", "delete": "canceled"}[end]
    assert (job["input"], stored(client)) == (None, 0)
    assert client.http.get(f"{place}/report").status_code == 409


def test_a_file_stays_for_another_attempt_and_is_forgotten_with_the_last(client: Client) -> None:
    place = sent(client)
    ledger, job_id = client.worker.ledger, place.rsplit("/", 1)[1]
    for attempts, there in ((1, True), (2, False)):
        assert ledger.claim(job_id, lease_seconds=-1)
        ledger.recover(2, WORKER_LOST)
        job = ledger.get(job_id)
        assert job
        assert (job.attempts, job.artifact(ArtifactKind.INPUT) is not None) == (attempts, there)
    assert client.http.get(place).json()["error"]["code"] == "worker_lost"


def test_the_same_file_of_another_job_is_not_deleted_with_it(client: Client) -> None:
    kept = client.submit()
    place = sent(client)
    client.run(place)
    assert client.http.get(kept).json()["input"] is not None
    client.run(kept)
    assert client.http.get(kept).json()["state"] == "succeeded"


def test_watermarks_and_verifications_do_not_see_each_other(client: Client) -> None:
    mark, place = client.submit(), sent(client)
    client.run(mark)
    client.run(place)
    for here, other in ((mark, place), (place, mark)):
        wrong = f"{here.rsplit('/', 1)[0]}/{other.rsplit('/', 1)[1]}"
        for method, part in (("GET", ""), ("GET", "/report"), ("GET", "/events"), ("DELETE", "")):
            assert client.http.request(method, wrong + part).status_code == 404, (method, wrong, part)
        listed = client.http.get(here.rsplit("/", 1)[0]).json()["items"]
        assert [job["links"]["self"] for job in listed] == [here]
    assert client.http.get(f"{mark}/evidence").status_code == 404
    assert client.http.get(f"{place}/model").status_code == 404


def test_results_are_used_again_for_watermarks_and_each_page_of_evidence_is_made_anew(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, cache=True)) as client:
        mark = client.submit()
        client.run(mark)
        client.run(sent(client))
        assert client.http.get(sent(client)).json()["state"] == "queued"
        assert client.http.get(client.submit()).json()["cached"] is True


def test_a_verification_has_events_of_its_own(client: Client) -> None:
    place = sent(client)
    client.run(place)
    told = client.http.get(f"{place}/events").text
    kinds = [line.removeprefix("event: ") for line in told.splitlines() if line.startswith("event: ")]
    assert kinds[:2] == ["verification.queued", "verification.running"]
    assert kinds[-1] == "verification.succeeded"
    assert {kind.partition(".")[0] for kind in kinds} == {"verification"}


def test_webhook_endpoints_are_told_of_verifications_only_where_they_ask(client: Client) -> None:
    asks: dict[str, Any] = {"usual": {}, "asking": {"events": ["verification.succeeded"]}}
    places = {}
    for name, more in asks.items():
        made = client.http.post("/v1/webhook-endpoints", json={"url": f"https://{name}.example/hook", **more})
        places[name] = made.headers["Location"]
    client.run(sent(client))
    told = {name: client.http.get(f"{place}/deliveries").json()["items"] for name, place in places.items()}
    assert told["usual"] == []
    assert [item["type"] for item in told["asking"]] == ["verification.succeeded"]


def test_a_webhook_that_would_never_be_sent_is_refused(client: Client) -> None:
    place = client.http.post("/v1/webhook-endpoints", json={"url": None}).headers["Location"]
    webhook: dict[str, Any] = {"data": {"webhook": "https://shop.example/hook"}}
    problem = refused(client, post(client, **webhook), 422, "no_webhook_secret")
    assert "verification.succeeded" in problem["remedy"]
    events = ["watermark.failed", "verification.failed"]
    assert client.http.patch(place, json={"events": events}).status_code == 200
    assert post(client, **webhook).status_code == 202


def test_without_texts_those_of_the_tenants_latest_watermarks_are_looked_for(client: Client) -> None:
    assert client.http.get(sent(client, params="{}")).json()["parameters"]["texts"] == []
    for text in ("FIRST", "SECOND", "FIRST", "ERASED"):
        place = client.submit(params=f'{{"text": "{text}"}}')
    client.http.delete(place)
    place = sent(client, params='{"texts": null}')
    client.submit(params='{"text": "LATER"}')
    assert client.http.get(place).json()["parameters"]["texts"] == ["FIRST", "SECOND"]
    assert client.http.get(sent(client, params='{"texts": []}')).json()["parameters"]["texts"] == []


def test_a_request_sent_again_is_the_same_though_the_tenants_texts_are_others_by_now(client: Client) -> None:
    key: dict[str, Any] = {"headers": {"Idempotency-Key": "4711"}}
    place = sent(client, params="{}", **key)
    client.submit()
    again = post(client, params="{}", **key)
    assert (again.headers["Location"], again.headers["Idempotent-Replayed"]) == (place, "true")
    assert post(client, params='{"texts": []}', **key).json()["code"] == "idempotency_key_reused"


@pytest.mark.parametrize(
    ("content", "params", "status", "code"),
    [
        (HUGE, "{}", 422, "budget_exceeded"),
        (HUGE[:20], "{}", 422, "malformed_file"),
        (b"GIF89a, which is no picture that is read", "{}", 415, "unknown_format"),
        (b"", "{}", 422, "empty_file"),
        (glb(HUGE_ACCESSOR), "{}", 422, "budget_exceeded"),
        (asset(), '{"texts": [""]}', 422, "invalid_parameters"),
        (asset(), json.dumps({"texts": ["x" * 201]}), 422, "invalid_parameters"),
        (asset(), json.dumps({"texts": ["HI"] * 33}), 422, "invalid_parameters"),
        (asset(), '{"keep": "yes"}', 422, "invalid_parameters"),
        (asset(), '{"text": "HI"}', 422, "invalid_parameters"),
        (asset(), "[]", 422, "invalid_parameters"),
    ],
)
def test_what_is_visibly_wrong_is_refused_at_once(
    client: Client, content: bytes, params: str, status: int, code: str
) -> None:
    response = post(client, content, params)
    refused(client, response, status, code)


def test_a_picture_is_for_verifications_alone(client: Client) -> None:
    picture = png(drawn("HELLO")[:64, :64])
    assert post(client, picture).status_code == 202
    response = client.http.post(
        "/v1/watermarks", files={"file": ("asset.png", picture)}, data={"params": '{"text": "HI"}'}
    )
    assert response.status_code == 415


def test_the_real_engine_reads_a_picture_and_shows_what_it_read(client: Client) -> None:
    client.worker.verifier = "core.verify.verify:verify"
    place = sent(client, png(drawn("watermark")), '{"texts": ["watermark", "sample"]}')
    client.run(place)
    job = client.http.get(place).json()
    assert job["state"] == "succeeded", job
    report = client.http.get(f"{place}/report").json()
    assert (report["found"], report["file"]["format"]) == (["watermark"], "png")
    assert "data:image/png;base64," in client.http.get(f"{place}/evidence").text


def seen(client: Client, place: str) -> str:
    """What came beside the file, as the tests' engine saw it."""
    client.run(place)
    job = client.http.get(place).json()
    assert job["state"] == "succeeded", job
    [warning] = client.http.get(f"{place}/report").json()["warnings"]
    return str(warning["message"])


def test_an_original_and_credentials_come_with_the_file_and_go_with_it(tmp_path: Path) -> None:
    roots = tmp_path / "roots.pem"
    roots.write_text("-----BEGIN ROOTS")
    with client_with(Settings(data_dir=tmp_path / "data", c2pa_trust=roots)) as client:
        files = {"original": ("original.obj", asset(name="original")), "credentials": ("s.c2pa", b"a manifest")}
        place = sent(client, files=files)
        assert stored(client) == 3
        assert seen(client, place) == ("original b'# {\"do\": \"wo', sidecar b'a manifest', anchors b'-----BEGIN R'")
        assert stored(client) == 2, "the report and the page"


def test_a_file_is_compared_with_what_a_job_of_ones_own_was_sent_and_told(client: Client) -> None:
    marked = client.submit(asset(name="original"), '{"text": "ORDER-4711"}')
    before = f'{{"watermark": "{marked.rsplit("/", 1)[1]}"}}'
    assert post(client, params=before).json()["code"] == "not_ready"
    client.run(marked)
    place = sent(client, params=before)
    assert client.http.get(place).json()["parameters"]["texts"] == [], "the report has them"
    assert seen(client, place) == 'original b\'# {"do": "wo\', marked b\'{"text": "OR\''
    assert client.http.get(f"{marked}/model").status_code == 200, "the job has its files still"
    assert client.http.delete(marked).status_code == 204
    assert post(client, params=before).json()["code"] == "not_ready"
    verification = f'{{"watermark": "{place.rsplit("/", 1)[1]}"}}'
    assert post(client, params=verification).json()["code"] == "not_found"
    both = {"original": ("original.obj", asset())}
    assert post(client, params=before, files=both).json()["code"] == "invalid_request"


def test_a_job_of_another_tenant_is_not_there_to_be_compared_with(public: Client) -> None:
    parts, headers = {"file": ("asset.obj", asset())}, bearer(public)
    sent_ = public.http.post("/v1/watermarks", files=parts, data={"params": '{"text": "HI"}'}, headers=headers)
    public.run(sent_.headers["Location"])
    params = f'{{"watermark": "{sent_.json()["id"]}"}}'
    assert post(public, params=params, headers=headers).status_code == 202
    assert post(public, params=params, headers=bearer(public, "other")).json()["code"] == "not_found"


@pytest.mark.parametrize(
    ("name", "content", "status", "code"),
    [
        ("original", b"", 422, "empty_file"),
        ("original", HUGE, 415, "unknown_format"),
        ("original", b"x" * 100_001, 413, "upload_too_large"),
        ("credentials", b"x" * (2**24 + 1), 413, "upload_too_large"),
    ],
)
def test_what_comes_beside_a_file_is_looked_at_too(
    client: Client, name: str, content: bytes, status: int, code: str
) -> None:
    refused(client, post(client, files={name: (name, content)}), status, code)


def open_to_all(folder: Path, **more: Any) -> Settings:
    """Of a service with keys that anybody may verify files with, twice a minute."""
    return Settings(data_dir=folder, auth="keys", public_verification=True, public_verifications_per_minute=2, **more)


@pytest.fixture
def public(tmp_path: Path) -> Iterator[Client]:
    with client_with(open_to_all(tmp_path)) as client:
        yield client


def bearer(client: Client, tenant: str = "acme") -> dict[str, str]:
    return {"Authorization": f"Bearer {create_key(client.worker.ledger.sessions, tenant, 'a key', Scope).text}"}


def test_anybody_may_verify_a_file_where_that_is_allowed(public: Client) -> None:
    place = sent(public, params="{}")
    public.run(place)
    job = public.http.get(place).json()
    assert (job["state"], job["input"], job["links"]["events"]) == ("succeeded", None, None)
    for part in ("report", "evidence"):
        assert public.http.get(job["links"][part]).status_code == 200
        assert public.http.head(job["links"][part]).status_code == 200
    headers = bearer(public)
    assert public.http.get(place, headers=headers).status_code == 404, "it is not theirs"
    theirs = sent(public, headers=headers)
    assert public.http.get(theirs).status_code == 404, "nor this anybody's"


def test_without_a_key_only_little_is_possible(public: Client) -> None:
    place = sent(public)
    for method, path in (
        ("GET", PLACE),
        ("DELETE", place),
        ("GET", f"{place}/events"),
        ("GET", "/v1/watermarks"),
        ("POST", "/v1/uploads"),
        ("POST", "/v1/watermarks"),
    ):
        response = public.http.request(method, path)
        assert (response.status_code, response.json()["code"]) == (401, "invalid_api_key"), (method, path)
    wrong = public.http.get(place, headers={"Authorization": "Bearer mm_wrong"})
    assert wrong.status_code == 401


@pytest.mark.parametrize(
    ("name", "request_"),
    [
        ("keep", {"params": '{"keep": true}'}),
        ("original", {"files": {"original": ("original.obj", asset())}}),
        ("watermark", {"params": '{"watermark": "6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11"}'}),
        ("webhook", {"data": {"webhook": "https://shop.example/hook"}}),
        ("metadata", {"data": {"metadata": '{"a": "b"}'}}),
        ("priority", {"data": {"priority": "high"}}),
        ("source_url", {"data": {"source_url": "https://files.example/a.glb"}}),
        ("upload_id", {"data": {"upload_id": "0" * 36}}),
        ("Idempotency-Key", {"headers": {"Idempotency-Key": "1"}}),
    ],
)
def test_what_is_not_for_anybody_is_refused_by_name(public: Client, name: str, request_: dict[str, Any]) -> None:
    problem = refused(public, post(public, **request_), 401, "invalid_api_key")
    assert f"`{name}`" in problem["detail"]


def test_an_address_that_asks_too_often_without_a_key_has_to_wait_and_a_key_has_not(public: Client) -> None:
    assert [post(public, b"").status_code for _ in range(2)] == [422, 422]
    limited = post(public)
    assert (limited.status_code, limited.json()["code"]) == (429, "rate_limited")
    assert 0 < int(limited.headers["Retry-After"]) <= 30
    assert post(public, headers=bearer(public)).status_code == 202
    assert public.http.get(f"{PLACE}/{'0' * 36}").status_code == 404, "questions are counted by themselves"


def test_without_texts_nobodys_texts_are_looked_for(public: Client) -> None:
    parts = {"file": ("asset.obj", asset())}
    data = {"params": '{"text": "SECRET"}'}
    assert public.http.post("/v1/watermarks", files=parts, data=data, headers=bearer(public)).status_code == 202
    assert public.http.get(sent(public, params="{}")).json()["parameters"]["texts"] == []


@pytest.mark.parametrize(("retention", "hour"), [(0, 3600), (600, 600), (7200, 3600)])
def test_what_anybody_sent_is_deleted_after_an_hour_and_erased(
    database_url: str, tmp_path: Path, retention: int, hour: int
) -> None:
    with client_with(open_to_all(tmp_path, database_url=database_url, retention_seconds=retention)) as public:
        place = sent(public, params='{"texts": ["my name"]}')
        theirs = sent(public, headers=bearer(public))
        ledger = public.worker.ledger
        job, other = [lease_of(public, each) for each in (place, theirs)]
        for lease in (job, other):
            assert ledger.succeed(lease)
        row, usual = ledger.get(job.job_id, PUBLIC_TENANT), ledger.get(other.job_id, "acme")
        assert row
        assert usual
        assert seconds_left(row) == hour
        assert seconds_left(usual) == (retention or None)
        with ledger.sessions.begin() as session:
            session.execute(update(Job).where(Job.id == row.id).values(purge_at=now()))
        remove_expired(public.worker)
        gone = public.http.get(place).json()
        assert (gone["state"], gone["parameters"]) == ("expired", None)
        with ledger.sessions() as session:
            assert "my name" not in str(session.execute(select(Job.parameters)).all())


def lease_of(client: Client, place: str) -> Lease:
    job = client.worker.ledger.claim(place.rsplit("/", 1)[1], 60)
    assert job
    return job.lease


def seconds_left(job: Job) -> float | None:
    assert job.finished_at
    return (job.expires_at - job.finished_at).total_seconds() if job.expires_at else None


def test_by_default_nothing_is_public(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, auth="keys")) as client:
        assert post(client).status_code == 401
        assert client.http.get(f"{PLACE}/{'0' * 36}").status_code == 401


def test_no_tenant_can_have_the_name_of_the_public_one(client: Client) -> None:
    with pytest.raises(ValueError, match="no tenant"):
        create_key(client.worker.ledger.sessions, PUBLIC_TENANT, "a key", Scope)


def test_another_tenants_verification_is_not_there(public: Client) -> None:
    place = sent(public, headers=bearer(public, "acme"))
    for method, part in (("GET", ""), ("GET", "/report"), ("GET", "/evidence"), ("GET", "/events"), ("DELETE", "")):
        response = public.http.request(method, place + part, headers=bearer(public, "beta"))
        assert response.status_code == 404, (method, part)


def test_a_leaked_copy_is_traced_to_its_buyer(client: Client) -> None:
    copies = [{"text": f"ORDER-47{number:02}", "metadata": {"customer": str(number)}} for number in range(40)]
    data = {"params": '{"text": "SAMPLE"}', "copies": json.dumps(copies)}
    job = client.http.post("/v1/watermarks", data=data, files={"file": ("asset.obj", asset())}).json()
    place = sent(client, params='{"texts": ["0RDER-4711", "Order-4711", "ORDER-471"]}')
    early = client.http.get(f"{place}/watermarks")
    assert (early.status_code, early.json()["code"]) == (409, "not_ready")
    client.run(place)
    client.run(place)
    first, *others = client.http.get(f"{place}/watermarks").json()["items"]
    assert (first["text"], first["likeness"], first["readings"]) == ("ORDER-4711", 1.0, 3)
    [copy] = first["jobs"]
    assert (copy["metadata"], copy["copy_of"]) == ({"customer": "11"}, job["id"])
    assert client.http.get(copy["link"]).json()["parameters"]["text"] == "ORDER-4711"
    assert len(others) == 19
    assert all(other["readings"] < 3 for other in others)
    assert client.http.delete(copy["link"]).status_code == 204
    left = client.http.get(f"{place}/watermarks").json()["items"]
    assert "ORDER-4711" not in [each["text"] for each in left], "it is erased"
    nobody = sent(client, params='{"texts": ["something else"]}')
    client.run(nobody)
    assert client.http.get(f"{nobody}/watermarks").json()["items"] == []
