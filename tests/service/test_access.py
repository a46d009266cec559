"""Access to every route of the OpenAPI document: with no key, a wrong one, and another tenant's."""

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml
from httpx2 import Response

from service.__main__ import openapi
from service.config import Settings
from service.jobs.tenants import Scope, create_key, revoke_key
from tests.service.conftest import Client, client_with
from tests.service.harness import API_COMMAND, Service
from tests.worker.engines import asset
from tests.worker.waiting import PATIENCE

DOCUMENT = yaml.safe_load(openapi())
OPERATIONS = [
    (method.upper(), path, operation)
    for path, operations in DOCUMENT["paths"].items()
    for method, operation in operations.items()
]
OPEN = {"/healthz", "/readyz"}  # what anybody may ask
# Results that no such job has: nothing is signed, and nobody asked for another format, a turntable, a light model or
# for reasons.
UNMADE = {
    f"/v1/watermarks/{{job_id}}/{part}"
    for part in (
        *("credentials", "export", "turntable", "poster", "explanation", "layers"),
        *("preview_model", "preview_manifest", "copies.zip"),
    )
}
OWN_TOKEN = {"/v1/hooks/{source}"}  # what asks for a token that is no API key: see tests/service/routes/test_hooks.py


@pytest.fixture
def client(database_url: str, tmp_path: Path) -> Iterator[Client]:
    settings = Settings(data_dir=tmp_path, database_url=database_url, auth="keys")
    with client_with(settings) as client:
        yield client


def bearer(client: Client, tenant: str = "acme", *scopes: Scope) -> dict[str, str]:
    """The header of a new key, good for everything unless said otherwise."""
    key = create_key(client.worker.ledger.sessions, tenant, "a key", scopes or Scope)
    return {"Authorization": f"Bearer {key.text}"}


BODIES: dict[tuple[str, str], dict[str, Any]] = {
    ("POST", "/v1/watermarks"): {"files": {"file": ("asset.obj", asset())}, "data": {"params": '{"text": "HI"}'}},
    ("POST", "/v1/watermarks/batch"): {"json": {"items": [{"upload_id": "none", "parameters": {"text": "HI"}}]}},
    ("POST", "/v1/watermarks/{job_id}/copies"): {"json": {"copies": [{"text": "YOU"}]}},
    ("POST", "/v1/verifications"): {"files": {"file": ("asset.obj", asset())}},
    ("POST", "/v1/conversions"): {"files": {"file": ("asset.obj", asset())}},
    ("POST", "/v1/uploads"): {"json": {"size": len(asset())}},
    ("PUT", "/v1/uploads/{upload_id}"): {"content": asset()},
    ("POST", "/v1/webhook-endpoints"): {"json": {"url": "https://shop.example/hook"}},
    ("PATCH", "/v1/webhook-endpoints/{endpoint_id}"): {"json": {}},
}


class Ids(NamedTuple):
    """What the paths name."""

    job_id: str = "0" * 36
    upload_id: str = "1" * 36
    endpoint_id: str = "2" * 36
    delivery_id: str = "3" * 36


def call(client: Client, method: str, path: str, ids: Ids, headers: dict[str, str]) -> Response:
    address = path.format(**ids._asdict(), source="incoming")
    return client.http.request(method, address, headers=headers, **BODIES.get((method, path), {}))


def things_of(client: Client, headers: dict[str, str]) -> Ids:
    """A finished job of a tenant, their webhook endpoint, a delivery of the one to the other, and an upload."""
    endpoint = call(client, "POST", "/v1/webhook-endpoints", Ids(), headers)
    job_id = finished_job(client, headers)
    address = endpoint.headers["Location"]
    [delivery] = client.http.get(f"{address}/deliveries", headers=headers).json()["items"]
    upload = call(client, "POST", "/v1/uploads", Ids(), headers)
    return Ids(job_id, upload.json()["id"], endpoint.json()["id"], delivery["id"])


def finished_job(client: Client, headers: dict[str, str]) -> str:
    response = call(client, "POST", "/v1/watermarks", Ids(), headers)
    assert response.status_code == 202, response.text
    client.run(response.headers["Location"])
    return str(response.json()["id"])


def test_another_tenants_things_are_not_there_on_any_route(client: Client) -> None:
    ours, theirs = bearer(client, "acme"), bearer(client, "beta")
    ids = things_of(client, ours)
    met = 0
    for method, path, _ in OPERATIONS:
        response = call(client, method, path, ids, theirs)
        told = response.text
        for mine, unknown in zip(ids, Ids(), strict=True):
            told = told.replace(f"'{mine}'", f"'{unknown}'")
        assert not any(mine in told for mine in ids), (method, path)
        if "{" in path:
            met += 1
            assert response.status_code == 404, (method, path)
            assert told == call(client, method, path, Ids(), theirs).text, "as if it had never been"
    assert met >= 16
    address = f"/v1/webhook-endpoints/{ids.endpoint_id}"
    assert client.http.get(address, headers=ours).json()["former_secret_until"] is None
    [delivery] = client.http.get(f"{address}/deliveries", headers=ours).json()["items"]
    assert delivery["id"] == ids.delivery_id
    job_id = ids.job_id
    job = client.http.get(f"/v1/watermarks/{job_id}", headers=ours).json()
    assert job["state"] == "succeeded"
    assert client.http.get(job["links"]["model"], headers=ours).content == b"glTF of HI"


def test_another_tenants_upload_cannot_be_used(client: Client) -> None:
    ours, theirs = bearer(client, "acme"), bearer(client, "beta")
    ids = Ids(upload_id=call(client, "POST", "/v1/uploads", Ids(), ours).json()["id"])
    assert call(client, "PUT", "/v1/uploads/{upload_id}", ids, ours).status_code == 204
    for headers, status in ((theirs, 404), (ours, 202)):
        data = {"params": '{"text": "HI"}', "upload_id": ids.upload_id}
        assert client.http.post("/v1/watermarks", headers=headers, data=data).status_code == status
        batch = {"items": [{"upload_id": ids.upload_id, "parameters": {"text": "HI"}}]}
        results = client.http.post("/v1/watermarks/batch", headers=headers, json=batch).json()["items"]
        assert [result["status"] for result in results] == [status]


def test_without_a_key_every_route_but_the_open_ones_is_closed(client: Client) -> None:
    ids = things_of(client, bearer(client))
    revoked = bearer(client)
    revoke_key(client.worker.ledger.sessions, revoked["Authorization"].split("_")[1])
    wrong = [
        {},
        revoked,
        {"Authorization": "Bearer"},
        {"Authorization": "Bearer mm_00000000_" + "0" * 43},
        {"Authorization": bearer(client)["Authorization"].replace("Bearer", "Basic")},
        {"Authorization": "Bearer \xe4".encode("latin-1")},
    ]
    for method, path, _ in OPERATIONS:
        for headers in wrong:
            response = call(client, method, path, ids, headers)  # type: ignore[arg-type]
            if path in OWN_TOKEN:
                assert response.status_code in (401, 404)
                continue
            if path in OPEN:
                assert response.status_code == 200
                continue
            assert response.status_code == 401, (method, path)
            expected = 'Bearer error="invalid_token"' if headers else "Bearer"
            assert response.headers["WWW-Authenticate"] == expected
            if method != "HEAD":
                assert response.json()["code"] == "invalid_api_key"


def test_a_key_does_what_its_scopes_say_and_nothing_else(client: Client) -> None:
    ids = things_of(client, bearer(client))
    for scope, other in ((Scope.READ, Scope.WRITE), (Scope.WRITE, Scope.READ)):
        headers = bearer(client, "acme", scope)
        for method, path, operation in OPERATIONS:
            if path in OPEN | OWN_TOKEN or method == "DELETE":
                continue
            response = call(client, method, path, ids, headers)
            needed = operation["security"][1]["api_key"]
            if needed == [scope]:
                there = path not in UNMADE and not path.startswith(("/v1/verifications/", "/v1/conversions/"))
                assert (response.status_code < 300) if there else (response.status_code == 404), (method, path)
            else:
                assert needed == [other]
                assert response.status_code == 403, (method, path)
                assert response.headers["WWW-Authenticate"] == f'Bearer error="insufficient_scope", scope="{other}"'
    reader = bearer(client, "acme", Scope.READ)
    refused = client.http.delete(f"/v1/watermarks/{ids.job_id}", headers=reader)
    assert (refused.status_code, refused.json()["code"]) == (403, "missing_scope")
    writer = bearer(client, "acme", Scope.WRITE)
    assert client.http.delete(f"/v1/watermarks/{ids.job_id}", headers=writer).status_code == 204


def test_a_key_that_asks_too_often_is_told_when_to_come_again(database_url: str, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, database_url=database_url, auth="keys", requests_per_minute=3)
    with client_with(settings) as client:
        busy, other = bearer(client), bearer(client)
        answers = [client.http.get("/v1/watermarks", headers=busy) for _ in range(4)]
        assert [answer.status_code for answer in answers] == [200, 200, 200, 429]
        assert answers[3].json()["code"] == "rate_limited"
        assert 1 <= int(answers[3].headers["Retry-After"]) <= 20
        assert client.http.get("/v1/watermarks", headers=other).status_code == 200


def test_every_guarded_operation_lists_how_access_is_refused() -> None:
    for method, path, operation in OPERATIONS:
        if path not in OPEN | OWN_TOKEN:
            assert {"401", "403", "429"} <= set(operation["responses"]), (method, path)
    assert DOCUMENT["components"]["securitySchemes"]["api_key"]["scheme"] == "bearer"


def test_the_scheme_is_read_as_http_writes_it(client: Client) -> None:
    text = bearer(client)["Authorization"].split()[1]
    job_id = finished_job(client, {"Authorization": f"bearer  {text}"})
    assert client.http.get(f"/v1/watermarks/{job_id}", headers={"Authorization": f"BEARER {text}"}).status_code == 200


def test_an_id_that_no_database_can_look_for_is_not_there(client: Client) -> None:
    headers = bearer(client)
    for text in ("%00", "a%00b", "%ff", "a" * 5000, "%F0%9F%A6%84"):
        assert client.http.get(f"/v1/watermarks/{text}", headers=headers).status_code == 404, text


def test_a_service_without_keys_serves_the_default_tenant_alone(database_url: str, tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, database_url=database_url, auth="keys")) as keyed:
        theirs = finished_job(keyed, bearer(keyed, "acme"))
        default = finished_job(keyed, bearer(keyed, "default"))
    with client_with(Settings(data_dir=tmp_path, database_url=database_url)) as keyless:
        assert keyless.http.get(f"/v1/watermarks/{theirs}").status_code == 404
        assert keyless.http.get(f"/v1/watermarks/{default}").status_code == 200


def test_who_has_no_key_is_answered_before_the_asset_is_sent(tmp_path: Path) -> None:
    service = Service(tmp_path, auth="keys")
    with service.running(API_COMMAND), socket.create_connection(("127.0.0.1", int(service.url.split(":")[2]))) as line:
        line.settimeout(PATIENCE)
        head = "POST /v1/watermarks HTTP/1.1\r\nHost: here\r\nContent-Length: 100000000\r\n"
        line.sendall(f"{head}Content-Type: multipart/form-data; boundary=x\r\n\r\n--x\r\n".encode())
        answer = b""
        while chunk := line.recv(65536):
            answer += chunk
        top, _, body = answer.partition(b"\r\n\r\n")
        assert top.startswith(b"HTTP/1.1 401 ")
        assert json.loads(body)["code"] == "invalid_api_key"
