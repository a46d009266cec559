import pytest
from sqlalchemy.exc import OperationalError

from service.jobs.ledger import Ledger
from tests.service.conftest import Client


def test_a_service_that_reaches_its_ledger_is_healthy(client: Client) -> None:
    response = client.http.get("/healthz")
    assert (response.status_code, response.json()) == (200, {"status": "ok"})


def test_a_service_without_its_ledger_is_not(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_self: Ledger) -> None:
        raise OperationalError("SELECT 1", {}, Exception("password=secret"))

    monkeypatch.setattr(Ledger, "ping", fail)
    response = client.http.get("/healthz")
    assert (response.status_code, response.json()["code"]) == (503, "service_unavailable")
    assert "secret" not in response.text
