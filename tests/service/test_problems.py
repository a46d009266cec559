import pytest

from core.errors import ErrorCode
from service.jobs.ledger import Ledger
from service.problems import STATUS
from tests.service.conftest import Client


def test_every_error_code_has_a_status() -> None:
    assert set(STATUS) == set(ErrorCode)


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
