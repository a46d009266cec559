import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
from fastapi import FastAPI
from sqlalchemy import Engine, event, text

from service.config import Settings
from service.jobs import database
from service.jobs.ledger import Ledger
from tests.service.conftest import Client, client_with
from tests.worker.waiting import PATIENCE


@pytest.fixture
def impatient_client(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Client]:
    monkeypatch.setitem(database.POOL, "pool_timeout", 0.1)
    with client_with(Settings(data_dir=tmp_path)) as client:
        yield client


def test_connections_that_many_need_at_once_are_opened_once_and_kept(database_url: str) -> None:
    ledger, at_once, opened = Ledger(database_url), 12, []
    engine = ledger.sessions.kw["bind"]
    assert isinstance(engine, Engine)
    event.listen(engine, "connect", lambda connection, _record: opened.append(connection))
    all_there = threading.Barrier(at_once)

    def ask(_: int) -> None:
        with ledger.sessions() as session:
            session.execute(text("SELECT 1"))
            all_there.wait(PATIENCE)

    with ThreadPoolExecutor(at_once) as pool:
        for _ in range(3):
            list(pool.map(ask, range(at_once)))
    assert len(opened) < at_once
    ledger.close()


def test_whoever_gets_no_connection_is_told_to_come_back(impatient_client: Client) -> None:
    url, app = impatient_client.submit(), impatient_client.http.app
    assert isinstance(app, FastAPI)
    with ExitStack() as stack:
        for _ in range(database.POOL["pool_size"]):
            stack.enter_context(app.state.meshmark.ledger.sessions.kw["bind"].connect())
        refused = impatient_client.http.get(url)
        assert (refused.status_code, refused.json()["code"]) == (503, "service_unavailable")
        assert refused.headers["Retry-After"]
        item = {"upload_id": "any", "parameters": {"text": "HI"}}
        batch = impatient_client.http.post("/v1/watermarks/batch", json={"items": [item]}).json()
        assert [each["status"] for each in batch["items"]] == [503]
    assert impatient_client.http.get(url).status_code == 200
