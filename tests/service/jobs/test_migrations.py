import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Connection, Engine, create_engine, inspect, text

from service.jobs import ledger
from service.jobs.ledger import Ledger
from service.jobs.migrations import migrate
from service.jobs.models import Base

# The schema as it was made before there were migrations, in the words of SQLite.
OLD = """
CREATE TABLE jobs (id VARCHAR(36) NOT NULL, state VARCHAR(16) NOT NULL, stage VARCHAR(32), progress DOUBLE NOT NULL,
    filename VARCHAR(255) NOT NULL, parameters JSON NOT NULL, created_at DATETIME NOT NULL,
    enqueued_at DATETIME NOT NULL, started_at DATETIME, finished_at DATETIME, attempts INTEGER NOT NULL,
    lease_token INTEGER NOT NULL, lease_expires_at DATETIME, error_code VARCHAR(64), error_message VARCHAR,
    error_remedy VARCHAR, PRIMARY KEY (id));
CREATE INDEX ix_jobs_state_enqueued_at ON jobs (state, enqueued_at);
CREATE TABLE artifacts (job_id VARCHAR(36) NOT NULL, kind VARCHAR(16) NOT NULL, sha256 VARCHAR(64) NOT NULL,
    size INTEGER NOT NULL, PRIMARY KEY (job_id, kind), FOREIGN KEY(job_id) REFERENCES jobs (id) ON DELETE CASCADE);
CREATE INDEX ix_artifacts_sha256 ON artifacts (sha256);
INSERT INTO jobs VALUES ('old', 'queued', NULL, 0.0, 'old.glb', '{"text": "HI"}', '2026-01-31 12:00:00.000000',
    '2026-01-31 12:00:00.000000', NULL, NULL, 0, 0, NULL, NULL, NULL, NULL);
INSERT INTO artifacts VALUES ('old', 'input', 'abab', 3)
"""


BEFORE_0010 = """
INSERT INTO jobs (id, state, progress, filename, parameters, created_at, enqueued_at, attempts, lease_token)
    VALUES ('job', 'succeeded', 1, 'a.glb', '{}', '2026-01-31 12:00:00', '2026-01-31 12:00:00', 1, 1);
INSERT INTO job_events VALUES ('job', 1, 'watermark.succeeded', '{}', '2026-01-31 12:00:00');
INSERT INTO webhook_endpoints (id, tenant_id, events, secret, former_secret, created_at)
    VALUES ('a', 'default', '[]', 'whsec_1', 'whsec_0', '2026-01-31 12:00:00');
INSERT INTO webhook_endpoints (id, tenant_id, events, secret, created_at)
    VALUES ('b', 'default', '[]', 'whsec_2', '2026-01-31 12:00:00');
INSERT INTO webhook_deliveries (id, endpoint_id, job_id, event_number, state, attempts, token, created_at)
    VALUES ('told', 'a', 'job', 1, 'delivered', 1, 1, '2026-01-31 12:00:00')
"""


@pytest.fixture
def engine(database_url: str) -> Iterator[Engine]:
    engine = create_engine(database_url)
    yield engine
    engine.dispose()


def test_where_the_steps_lead_is_what_the_models_say(database_url: str, engine: Engine) -> None:
    Ledger(database_url).close()
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []


def test_a_database_from_before_there_were_migrations_is_adopted_with_its_jobs(
    database_url: str, engine: Engine
) -> None:
    Ledger(database_url).close()  # makes the folder of a SQLite file
    with engine.begin() as connection:
        for table in inspect(connection).get_table_names():
            connection.execute(text(f"DROP TABLE {table} {'CASCADE' if engine.name == 'postgresql' else ''}"))
        old = OLD if engine.name == "sqlite" else OLD.replace("DATETIME", "TIMESTAMP").replace("DOUBLE", "FLOAT(53)")
        for statement in old.split(";"):
            connection.exec_driver_sql(statement)
    adopted = Ledger(database_url)
    job = adopted.claim("old", 60)
    adopted.close()
    assert job is not None
    assert job.tenant_id == "default"
    assert (job.filename, job.parameters, [item.sha256 for item in job.artifacts]) == (
        "old.glb",
        {"text": "HI"},
        ["abab"],
    )
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []


def test_what_refers_to_an_endpoint_outlives_the_widening_of_its_secrets(database_url: str, engine: Engine) -> None:
    if engine.name == "sqlite":
        Path(engine.url.database or "").parent.mkdir()
    with engine.begin() as connection:
        if engine.name == "sqlite":
            connection.exec_driver_sql("PRAGMA foreign_keys=ON")
        migrate(connection, "0009")
        for statement in BEFORE_0010.split(";"):
            connection.exec_driver_sql(statement)
    Ledger(database_url).close()
    with engine.connect() as connection:
        rows = connection.exec_driver_sql("SELECT id, secret, former_secret FROM webhook_endpoints ORDER BY id")
        assert [tuple(row) for row in rows] == [("a", "whsec_1", "whsec_0"), ("b", "whsec_2", None)]
        assert connection.exec_driver_sql("SELECT id FROM webhook_deliveries").scalar_one() == "told"


def test_what_fails_halfway_leaves_the_database_as_it_was(
    database_url: str, engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    def migrate_and_fail(connection: Connection) -> None:
        migrate(connection)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(ledger, "migrate", migrate_and_fail)
        with pytest.raises(KeyboardInterrupt):
            Ledger(database_url)
    assert inspect(engine).get_table_names() == []
    Ledger(database_url).close()
    assert "jobs" in inspect(engine).get_table_names()


def test_of_many_processes_that_start_at_once_one_migrates(database_url: str) -> None:
    script = (
        "import logging, sys; logging.basicConfig(level='INFO')\n"
        "from service.jobs.ledger import Ledger\n"
        "sys.stdin.read(1); Ledger(sys.argv[1]).close()"
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", script, database_url], stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        for _ in range(4)
    ]
    with ThreadPoolExecutor(4) as pool:
        logs = [log for _, log in pool.map(lambda process: process.communicate("x"), processes)]
    assert [process.returncode for process in processes] == [0] * 4, [log[-1500:] for log in logs]
    assert sum("Running upgrade  -> 0001" in log for log in logs) == 1


def test_threads_of_one_process_may_open_the_ledger_at_once(database_url: str) -> None:
    with ThreadPoolExecutor(8) as pool:
        ledgers = list(pool.map(lambda _: Ledger(database_url), range(8)))
    job_id = ledgers[0].create("asset.glb", {"text": "HI"}, {}, lambda _: True).id
    assert all(opened.get(job_id) for opened in ledgers)
    for opened in ledgers:
        opened.close()


def test_a_new_sqlite_file_that_another_process_holds_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite3"
    with closing(sqlite3.connect(path, isolation_level=None)) as other, ThreadPoolExecutor(1) as pool:
        other.execute("BEGIN EXCLUSIVE")
        opening = pool.submit(Ledger, f"sqlite:///{path}")
        with pytest.raises(TimeoutError):
            opening.result(0.3)
        other.execute("ROLLBACK")
        opening.result(5).close()
