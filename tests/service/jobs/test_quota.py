from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest
from sqlalchemy import create_engine

from core.errors import MeshmarkError
from service.config import Settings
from service.errors import ServiceErrorCode
from service.jobs import uploads
from service.jobs.forgetting import drop_artifacts
from service.jobs.ledger import Content, Ledger, Submission
from service.jobs.migrations import migrate
from service.jobs.models import ArtifactKind, Tenant
from service.jobs.quota import check_stored
from tests.service.conftest import client_with

INPUT, MODEL, REPORT = ArtifactKind.INPUT, ArtifactKind.MODEL, ArtifactKind.REPORT
BEFORE_0011 = """
INSERT INTO jobs (id, tenant_id, state, progress, filename, parameters, created_at, enqueued_at, attempts, lease_token)
    VALUES ('a', 'default', 'succeeded', 1, 'a', '{}', '2026-01-31 12:00:00', '2026-01-31 12:00:00', 1, 1);
INSERT INTO jobs (id, tenant_id, state, progress, filename, parameters, created_at, enqueued_at, attempts, lease_token)
    VALUES ('b', 'of-a-hook', 'failed', 1, 'b', '{}', '2026-01-31 12:00:00', '2026-01-31 12:00:00', 1, 1);
INSERT INTO artifacts VALUES ('a', 'input', 'aa', 3);
INSERT INTO artifacts VALUES ('a', 'model', 'bb', 5000000000);
INSERT INTO artifacts VALUES ('b', 'input', 'aa', 3)
"""


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    with closing(Ledger(database_url)) as ledger:
        yield ledger


def stored(ledger: Ledger, tenant: str = "acme") -> int:
    with ledger.sessions() as session:
        return session.get_one(Tenant, tenant).stored_bytes


def submit(ledger: Ledger, size: int, most: int = 0, tenant: str = "acme") -> str:
    condition = Submission(tenant, condition=lambda session, _: check_stored(session, tenant, most))
    return ledger.create("a.glb", {}, {INPUT: Content(f"{size:064}", size)}, lambda _: True, condition).id


def test_every_byte_that_is_stored_and_removed_is_counted_once(ledger: Ledger) -> None:
    job_id = submit(ledger, 100)
    submit(ledger, 100)  # the same content: each job's files count for themselves
    assert stored(ledger) == 200
    job = ledger.claim(job_id, 60)
    assert job
    for kind, size, expected in ((MODEL, 50, 250), (MODEL, 70, 270), (MODEL, 20, 220), (REPORT, 1, 221)):
        assert ledger.publish(job.lease, kind, Content("f" * 64, size), lambda _: True)
        assert stored(ledger) == expected
    ledger.drop_outputs(job.lease)
    assert stored(ledger) == 200
    assert not ledger.publish(job.lease._replace(token=99), MODEL, Content("f" * 64, 50), lambda _: True)
    ledger.cancel(job_id, "acme")
    for _ in range(2):
        drop_artifacts(ledger.sessions, job_id)
        assert stored(ledger) == 100


def test_what_is_stored_at_once_is_counted_whole(ledger: Ledger) -> None:
    with ThreadPoolExecutor(8) as pool:
        ids = list(pool.map(lambda number: submit(ledger, number, tenant=f"t{number % 2}"), range(1, 41)))
        assert (stored(ledger, "t0"), stored(ledger, "t1")) == (420, 400)
        list(pool.map(lambda item: ledger.cancel(item, "t0") or ledger.cancel(item, "t1"), ids))
        list(pool.map(partial(drop_artifacts, ledger.sessions), ids))
    assert (stored(ledger, "t0"), stored(ledger, "t1")) == (0, 0)


def test_nothing_is_recorded_beyond_the_quota_until_there_is_room(ledger: Ledger) -> None:
    kept = submit(ledger, 60, 100)
    for _ in range(2):
        with pytest.raises(MeshmarkError, match="110 bytes would be stored for you, and 100 are the most") as refused:
            submit(ledger, 50, 100)
        assert refused.value.code == ServiceErrorCode.QUOTA_EXCEEDED
        assert stored(ledger) == 60
    submit(ledger, 50, 100, tenant="beta")
    ledger.cancel(kept, "acme")
    drop_artifacts(ledger.sessions, kept)
    submit(ledger, 50, 100)


def test_what_is_sent_ahead_counts_from_its_declaration(ledger: Ledger) -> None:
    submit(ledger, 60, 100)
    uploads.begin(ledger.sessions, "acme", "a.glb", 40, None, 0, 100)
    for begin in (lambda: submit(ledger, 1, 100), lambda: uploads.begin(ledger.sessions, "acme", "a", 1, None, 0, 100)):
        with pytest.raises(MeshmarkError, match="101 bytes"):
            begin()


def test_what_there_was_before_it_was_counted_is_counted_by_the_migration(database_url: str) -> None:
    engine = create_engine(database_url)
    if engine.name == "sqlite":
        Path(engine.url.database or "").parent.mkdir()
    with engine.begin() as connection:
        migrate(connection, "0010")
        for statement in BEFORE_0011.split(";"):
            connection.exec_driver_sql(statement)
    engine.dispose()
    with closing(Ledger(database_url)) as ledger:
        assert (stored(ledger, "default"), stored(ledger, "of-a-hook")) == (5_000_000_003, 3)


def test_a_client_is_told_by_403_and_makes_room_by_deleting(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, max_stored_bytes=100)) as client:
        triangle = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
        first, second = (
            {"file": ("a.obj", triangle + b"#" * (60 - len(triangle)) + letter)} for letter in (b"1", b"2")
        )
        data = {"params": '{"text": "HI"}'}
        url = client.http.post("/v1/watermarks", files=first, data=data).headers["Location"]
        for refused in (
            client.http.post("/v1/watermarks", files=second, data=data),
            client.http.post("/v1/uploads", json={"size": 60}),
        ):
            assert (refused.status_code, refused.json()["code"]) == (403, "quota_exceeded")
        assert len(list(client.artifacts.listing())) == 1, "nothing is kept of what was refused"
        client.http.delete(url)
        assert client.http.post("/v1/watermarks", files=second, data=data).status_code == 202
