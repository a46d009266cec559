"""A disk that is full, as the service sees one: nothing can be written but in the room that the reserve held."""

import errno
import os
import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from sqlalchemy import event
from sqlalchemy.exc import OperationalError

from service import readiness
from service.config import Settings
from service.jobs.models import JobState
from service.jobs.reserve import SIZE, Reserve
from service.jobs.tenants import Scope, create_key
from tests.service.conftest import Client, client_with
from tests.worker.engines import asset
from worker.sweeper import FileSweep


def full(*_: Any, **__: Any) -> Any:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def fill(folder: Path, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    reserve = folder / "artifacts" / "reserve"
    for name in ("mkstemp", "TemporaryFile"):
        monkeypatch.setattr(tempfile, name, full)
    monkeypatch.setattr(os, "posix_fallocate", full)
    monkeypatch.setattr(os, "statvfs", lambda _: SimpleNamespace(f_bavail=0, f_frsize=4096, f_blocks=2**20))

    def write(_connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        if not statement.lstrip().startswith(("SELECT", "PRAGMA", "BEGIN")) and reserve.exists():
            raise OperationalError(statement, None, sqlite3.OperationalError("database or disk is full"))

    for ledger in (client.http.app.state.meshmark.ledger, client.worker.ledger):  # type: ignore[attr-defined]
        event.listen(ledger.sessions.kw["bind"], "before_cursor_execute", write)


@pytest.fixture
def client(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Client]:
    monkeypatch.setattr(readiness, "CACHED", 0.0)
    with client_with(Settings(data_dir=tmp_path, auth="keys", retention_seconds=0.001)) as client:
        key = create_key(client.worker.ledger.sessions, "default", "test", [*Scope])
        client.http.headers["Authorization"] = f"Bearer {key.text}"
        yield client


def test_a_full_disk_is_503_with_a_time_to_come_back_and_what_makes_room_is_done(
    client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = client.submit()
    digest = client.http.get(url).json()["input"]["sha256"]
    stored = tmp_path / "artifacts" / digest[:2] / digest
    assert (stored.exists(), client.http.get("/readyz").status_code) == (True, 200)
    with monkeypatch.context() as patch:
        fill(tmp_path, client, patch)
        request = {"files": {"file": ("asset.obj", asset(number=2))}, "data": {"params": '{"text": "HI"}'}}
        upload = client.http.post("/v1/watermarks", **request)  # type: ignore[arg-type]
        for refused in (client.http.get("/readyz"), upload, client.http.post("/v1/uploads", json={"size": 1})):
            assert (refused.status_code, refused.headers["Retry-After"]) == (503, "5")
        assert client.http.delete(url).status_code == 204
        assert not stored.exists()
        assert client.http.get(url).json()["state"] == "canceled"
        again = client.http.post("/v1/watermarks", **request)  # type: ignore[arg-type]
        assert again.status_code == 503, "the room that was freed is not for uploads"
    client.http.get("/readyz")  # which asks ledger and store at the same time
    assert (tmp_path / "artifacts" / "reserve").exists(), "as soon as there is room, it is kept again"
    assert client.http.get("/readyz").status_code == 503, "the ledger's listener still finds its disk full"


def test_what_has_expired_goes_on_a_full_disk_too(
    client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = client.submit()
    client.run(url)
    fill(tmp_path, client, monkeypatch)
    passes = FileSweep(client.worker)
    with pytest.raises(OperationalError):
        passes.step()
    passes.step()
    job = client.worker.ledger.get(url.rsplit("/", 1)[1])
    assert job is not None
    assert (job.state, job.artifacts) == (JobState.EXPIRED, [])


def test_the_reserve_is_room_that_is_taken_and_comes_back_once_there_is_some(tmp_path: Path) -> None:
    reserve, path = Reserve(tmp_path), tmp_path / "reserve"
    reserve.keep()
    held = path.stat()
    assert held.st_blocks * 512 >= held.st_size > 0
    assert held.st_size <= SIZE
    path.unlink()
    reserve.keep()
    assert path.stat().st_size == held.st_size
