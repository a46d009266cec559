import json
from typing import Any

import pytest
from httpx2 import Response

from core.errors import ErrorCode
from service.errors import ServiceErrorCode
from service.jobs.ledger import Ledger
from service.problems import STATUS
from tests.service.conftest import Client


def test_every_error_code_has_a_status() -> None:
    assert set(STATUS) == {*ErrorCode, *ServiceErrorCode}


def test_an_unknown_path_is_a_problem(client: Client) -> None:
    response = client.http.get("/nothing")
    assert response.headers["Content-Type"] == "application/problem+json"
    assert (response.status_code, response.json()["code"]) == (404, "not_found")


def test_a_wrong_method_is_a_problem_that_names_the_right_ones(client: Client) -> None:
    response = client.http.put("/v1/watermarks")
    assert (response.status_code, response.json()["code"]) == (405, "method_not_allowed")
    assert response.headers["Allow"] == "GET, POST"
    assert client.http.put("/v1/watermarks/1").headers["Allow"] == "DELETE, GET"
    assert set(client.http.put("/openapi.json").headers["Allow"].split(", ")) == {"GET", "HEAD"}


def test_a_bug_is_a_problem_without_its_details(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_self: Ledger, _job_id: str, _tenant: str) -> None:
        raise RuntimeError("secret detail")

    monkeypatch.setattr(Ledger, "get", fail)
    response = client.http.get("/v1/watermarks/1")
    assert response.headers["Content-Type"] == "application/problem+json"
    assert (response.status_code, response.json()["code"]) == (500, "internal_error")
    assert "secret" not in response.text


def post_json(client: Client, path: str, content: Any) -> Response:
    body = content if isinstance(content, bytes) else json.dumps(content).encode()
    return client.http.post(path, content=body, headers={"Content-Type": "application/json"})


def refused(answer: Response, status: int, code: str, *says: str) -> None:
    problem = answer.json()
    assert (answer.status_code, problem["code"]) == (status, code), problem
    for words in says:
        assert words in problem["detail"]
    assert len(answer.content) < 2000


MANY = {str(number): 1 for number in range(5000)}
LONG = {"n" * 3000 + str(number): 1 for number in range(12)}


def test_an_error_in_a_body_is_told_briefly_however_much_is_wrong_with_it(client: Client) -> None:
    refused(post_json(client, "/v1/uploads", {"size": 1} | MANY), 400, "invalid_request", "5001")
    refused(post_json(client, "/v1/uploads", LONG), 400, "invalid_request")
    refused(post_json(client, "/v1/webhook-endpoints", {"url": "x"} | MANY), 400, "invalid_request", "5001")
    refused(post_json(client, "/v1/watermarks/batch", {"items": [MANY] * 5}), 400, "invalid_request", "5000")
    items = [{"upload_id": str(number), "colour": 1} for number in range(100)]
    refused(post_json(client, "/v1/watermarks/batch", {"items": items}), 400, "invalid_request", "and 190 more")
    item = {"upload_id": "x", "parameters": {"text": "a"} | MANY, "metadata": MANY}
    results = post_json(client, "/v1/watermarks/batch", {"items": [item]})
    assert results.json()["items"][0]["problem"]["code"] == "invalid_parameters"
    assert len(results.content) < 2000
    for field in ("params", "metadata"):
        fields = {"params": '{"text": "a"}', "metadata": "{}"} | {field: json.dumps(MANY)}
        answer = client.http.post("/v1/watermarks", data=fields, files={"file": ("a.obj", b"v 0 0 0")})
        refused(answer, 422, f"invalid_{field.replace('params', 'parameters')}")


def test_json_of_many_values_is_not_even_parsed(client: Client) -> None:
    values: Any
    for values in ([[]] * 60_000, {str(number): 0 for number in range(60_000)}):
        item = {"upload_id": "x", "parameters": {"text": values}}
        refused(post_json(client, "/v1/watermarks/batch", {"items": [item]}), 400, "invalid_request", "50,000 values")
    items = [{"upload_id": "x", "parameters": {"text": "a" * 9000}}] * 100
    assert post_json(client, "/v1/watermarks/batch", {"items": items}).status_code == 207


def test_what_a_client_sent_is_repeated_only_in_part(client: Client) -> None:
    long = "n" * 5000
    refused(client.http.get(f"/{long}"), 404, "not_found")
    refused(client.http.request(long, "/v1/watermarks"), 405, "method_not_allowed")
    refused(
        client.http.post("/v1/uploads", content=b"x", headers={"Content-Type": long}), 415, "unsupported_media_type"
    )
    refused(client.http.get(f"/v1/watermarks/{long}"), 404, "not_found")
    refused(client.http.get("/v1/watermarks", params={"metadata": long}), 422, "invalid_metadata")
    refused(client.http.get("/v1/watermarks", params={"state": long, "limit": long}), 400, "invalid_request", "limit")


@pytest.mark.parametrize(("path", "limit"), [("/v1/uploads", 65_536), ("/v1/watermarks/batch", 1_048_576)])
def test_a_body_that_is_no_asset_is_small_whether_it_says_so_or_not(client: Client, path: str, limit: int) -> None:
    body = json.dumps({"filename": "n" * limit}).encode()
    refused(post_json(client, path, body), 413, "upload_too_large", f"{limit:,}")
    untold = client.http.post(path, content=iter([body]), headers={"Content-Type": "application/json"})
    refused(untold, 413, "upload_too_large", f"{limit:,}")


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (b'{"size": }', "not JSON at character 9"),
        (b'{"size": "\xff"}', "UTF-8"),
        (b"[" * 40_000, "nested"),
        (b"", "body"),
    ],
)
def test_who_sends_json_that_is_none_is_not_told_to_send_a_form(client: Client, body: bytes, says: str) -> None:
    answer = post_json(client, "/v1/uploads", body)
    refused(answer, 400, "invalid_request", says)
    assert "application/json" in answer.json()["remedy"]


def test_no_prefix_of_the_frameworks_stands_in_a_sentence(client: Client) -> None:
    answers = [post_json(client, "/v1/uploads", body) for body in (b'{"size": }', {"size": -1}, {})]
    answers += [client.http.get("/v1/watermarks", params={"created_after": moment}) for moment in ("now", "2026-01-01")]
    for answer in answers:
        assert answer.status_code == 400
        assert "Value error" not in answer.text
        assert "decode error" not in answer.text


@pytest.mark.parametrize("path", ["/v1/watermarks/", "/v1/uploads/", "/v1/webhook-endpoints/", "/healthz/"])
def test_no_path_leads_to_another_host(client: Client, path: str) -> None:
    for method in ("GET", "POST"):
        answer = client.http.request(method, path, headers={"Host": "evil.example"})
        refused(answer, 404, "not_found")
        assert "Location" not in answer.headers
