"""With a long past in the ledger, nothing that is done often reads all of it."""

import json
from collections.abc import Iterator
from datetime import timedelta
from typing import Any

import pytest
from sqlalchemy import Engine, event, text

from service.jobs import cache, dropped, events, idempotency, sources, turns, uploads
from service.jobs.clock import now
from service.jobs.dead import WORKER_LOST
from service.jobs.forgetting import forget, overdue
from service.jobs.known_texts import known_texts
from service.jobs.ledger import Content, Ledger, Submission
from service.jobs.ledger_metrics import LedgerCollector
from service.jobs.limits import check_active
from service.jobs.listing import Filters, list_jobs
from service.jobs.models import ArtifactKind, JobState, Queue
from service.jobs.references import discard, unreferenced
from service.webhooks import deliveries
from tests.service.postgres import Postgres

JOBS = 10_000  # of the past; few besides wait and run
# Jobs of the past half a year, ended but for the last ones, with all that they leave behind.
FILL = """
INSERT INTO tenants SELECT 't' || n, now() FROM generate_series(1, 5) AS n;
INSERT INTO jobs (id, tenant_id, queue, state, progress, filename, parameters, created_at, enqueued_at, started_at,
                  finished_at, purge_at, result_key, attempts, lease_token, lease_expires_at, event_count)
SELECT 'job' || n, 't' || n % 5 + 1, 'small',
       CASE WHEN n <= {jobs} THEN 'succeeded' WHEN n <= {jobs} + 100 THEN 'queued' ELSE 'running' END,
       1, 'asset.obj', '{{}}', moment, moment, CASE WHEN n <= {jobs} THEN moment END,
       CASE WHEN n <= {jobs} THEN moment END, CASE WHEN n <= {jobs} THEN moment + interval '1 year' END,
       md5('' || n), 1, 1, moment, 5
FROM generate_series(1, {jobs} + 110) AS n,
     LATERAL (SELECT (now() AT TIME ZONE 'UTC') - ({jobs} + 110 - n) * interval '26 minutes' AS moment) AS past;
INSERT INTO artifacts SELECT id, file, md5(id || file) || md5(file || id), 1
FROM jobs, unnest(ARRAY['input', 'model', 'report', 'preview']) AS file;
INSERT INTO job_metadata SELECT id, 'order', id FROM jobs;
INSERT INTO job_events (job_id, number, type, data, created_at)
SELECT id, number, 'watermark.succeeded', '{{}}', created_at FROM jobs, generate_series(1, 5) AS number
WHERE created_at > (now() AT TIME ZONE 'UTC') - interval '30 days';
INSERT INTO idempotency_keys
SELECT tenant_id, id, '', '', id, (now() AT TIME ZONE 'UTC') + interval '1 day' FROM jobs;
INSERT INTO uploads SELECT id, tenant_id, 'asset.obj', 1, NULL, created_at, created_at + interval '2 years' FROM jobs;
INSERT INTO webhook_endpoints (id, tenant_id, events, secret, created_at)
SELECT 'endpoint of ' || id, id, '[]', '', now() FROM tenants;
INSERT INTO webhook_deliveries (id, endpoint_id, job_id, event_number, state, attempts, token, created_at)
SELECT job_id, 'endpoint of t1', job_id, number, 'delivered', 1, 1, created_at FROM job_events WHERE number = 1;
INSERT INTO webhook_deliveries (id, endpoint_id, tenant_id, job_id, event_number, state, attempts, due_at, token,
                                created_at)
SELECT 'waits ' || job_id || number, 'endpoint of t' || number, 't' || number, job_id, number, 'pending', 1,
       (now() AT TIME ZONE 'UTC') + interval '1 day' * (2 - number), 1, created_at
FROM job_events WHERE number IN (1, 3) AND job_id LIKE '%0';
INSERT INTO dropped_objects (id, job_id, source, key, output, tries, due_at, created_at)
SELECT id, id, 'source', id, 'written', 1, created_at, created_at FROM jobs;
"""


class Statements:
    """What is sent to the database from here on."""

    def __init__(self, engine: Engine) -> None:
        self.sent: list[tuple[str, Any]] = []
        event.listen(engine, "before_cursor_execute", self._note)

    def _note(self, _connection: Any, _cursor: Any, statement: str, parameters: Any, *_: Any) -> None:
        if statement.lstrip("( \n").startswith(("SELECT", "UPDATE", "DELETE", "INSERT", "WITH")):
            self.sent.append((statement, parameters))


@pytest.fixture(scope="module")
def ledger(postgres: Postgres) -> Iterator[Ledger]:
    ledger = Ledger(postgres.new_database())
    try:
        with ledger.sessions.begin() as session:
            session.execute(text(FILL.format(jobs=JOBS)))
        with ledger.sessions() as session:
            session.connection(execution_options={"isolation_level": "AUTOCOMMIT"}).execute(text("ANALYZE"))
        yield ledger
    finally:
        ledger.close()


def accept(ledger: Ledger) -> None:
    with ledger.sessions() as session:
        check_active(session, "t1", 1000)
    cache.find_results(ledger.sessions, "t1", "key")
    known_texts(ledger.sessions, "t1")
    reservation = idempotency.reserve(ledger.sessions, "t1", "a key", "print")
    assert isinstance(reservation, idempotency.Reservation)
    submission = Submission("t1", condition=lambda session, job_id: idempotency.settle(session, reservation, job_id))
    ledger.create("asset.obj", {}, {ArtifactKind.INPUT: Content("0" * 64, 1)}, lambda _: True, submission)


def work(ledger: Ledger) -> None:
    job = turns.claim_next(ledger, Queue.SMALL, 60)
    assert job
    turns.queue_of(ledger.sessions, job.id)
    ledger.drop_outputs(job.lease)
    assert ledger.heartbeat(job.lease, 60, "placing", 0.5)
    assert ledger.publish(job.lease, ArtifactKind.MODEL, Content("1" * 64, 1), lambda _: True)
    assert ledger.succeed(job.lease)
    discard(ledger.sessions, "2" * 64, lambda _: None)
    unreferenced(ledger.sessions, {"2" * 64})


def look(ledger: Ledger) -> None:
    moment = now() - timedelta(hours=1)
    assert ledger.get("job1", "t2")
    events.read(ledger.sessions, "job10000")
    first = list_jobs(ledger.sessions, "t1", Filters(), 20)
    for filters in (
        Filters(),
        Filters(state=JobState.QUEUED),
        Filters(state=JobState.FAILED),
        Filters(created_after=moment),
        Filters(created_before=moment),
        Filters(metadata=("order", "job10")),
    ):
        list_jobs(ledger.sessions, "t1", filters, 20, first.cursor)
        list_jobs(ledger.sessions, "t1", filters, 20)
    assert uploads.find(ledger.sessions, "t1", "job10")


def measure(ledger: Ledger) -> None:
    assert len(list(LedgerCollector(ledger.sessions).collect())) >= 3


def sweep(ledger: Ledger) -> None:
    assert ledger.recover(2, WORKER_LOST)[0]
    for queue in Queue:
        ledger.waiting(60, queue)
    assert overdue(ledger.sessions) == []
    ledger.running()
    idempotency.forget(ledger.sessions)
    events.forget(ledger.sessions, now() - events.KEPT)
    sources.forget(ledger.sessions)
    assert forget(ledger.sessions, timedelta(days=90)) == (0, set())


def tell(ledger: Ledger) -> None:
    for lost in (False, True, False):
        deliveries.announce(ledger.sessions, lost)
    dropped.take_due(ledger.sessions, "source")


@pytest.mark.parametrize("act", [accept, work, look, measure, sweep, tell])
def test_what_is_done_often_reads_no_table_as_a_whole(ledger: Ledger, act: Any) -> None:
    statements = Statements(ledger.sessions.kw["bind"])
    act(ledger)
    sent = list(statements.sent)
    with ledger.sessions() as session:
        cursor = session.connection().connection.cursor()
        large = {name for (name,) in cursor.execute("SELECT relname FROM pg_class WHERE reltuples > 1000").fetchall()}
        assert {"jobs", "artifacts", "job_events", "job_metadata", "idempotency_keys", "uploads"} <= large
        for statement, parameters in sent:
            for values in parameters if isinstance(parameters, list) else [parameters]:
                (plan,) = cursor.execute(f"EXPLAIN (FORMAT JSON) {statement}", values).fetchone()
                read = {node["Relation Name"] for node in nodes(plan[0]["Plan"]) if node["Node Type"] == "Seq Scan"}
                assert not read & large, f"{statement}\n{json.dumps(plan, indent=1)}"


def nodes(plan: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield plan
    for child in plan.get("Plans", ()):
        yield from nodes(child)
