import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, event, insert

from service.jobs.clock import now
from service.jobs.ledger import Ledger, Submission
from service.jobs.models import Job, JobState, Priority, Queue
from service.jobs.turns import claim_next, next_job, queue_of

HIGH, NORMAL, LOW = Priority


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


def send(ledger: Ledger, tenant: str, priority: Priority = NORMAL, queue: Queue = Queue.SMALL, jobs: int = 1) -> None:
    for _ in range(jobs):
        submission = Submission(tenant, queue=queue, priority=priority)
        ledger.create("asset.obj", {}, {}, lambda _: True, submission)


def started(ledger: Ledger, places: int, queue: Queue = Queue.SMALL) -> list[tuple[str, Priority]]:
    jobs = [claim_next(ledger, queue, 60) for _ in range(places)]
    return [(job.tenant_id, Priority(job.priority)) for job in jobs if job]


def test_a_tenant_who_comes_late_is_not_behind_all_jobs_of_another(ledger: Ledger) -> None:
    send(ledger, "busy", jobs=20)
    assert started(ledger, 2) == [("busy", NORMAL)] * 2
    send(ledger, "late", jobs=2)
    tenants = [tenant for tenant, _ in started(ledger, 6)]
    assert tenants == ["late", "busy", "late", "busy", "busy", "busy"]


def test_tenants_take_turns_whatever_priority_they_give_their_jobs(ledger: Ledger) -> None:
    send(ledger, "loud", HIGH, jobs=9)
    send(ledger, "quiet", LOW, jobs=3)
    send(ledger, "usual", jobs=3)
    tenants = [tenant for tenant, _ in started(ledger, 9)]
    assert {tenant: tenants.count(tenant) for tenant in tenants} == {"loud": 3, "quiet": 3, "usual": 3}
    assert [set(tenants[at : at + 3]) for at in (0, 3, 6)] == [{"loud", "quiet", "usual"}] * 3


def test_a_tenants_own_jobs_go_by_priority_and_then_by_age(ledger: Ledger) -> None:
    ids = []
    for priority in (LOW, NORMAL, HIGH, NORMAL):
        ids.append(ledger.create("a", {}, {}, lambda _: True, Submission("acme", priority=priority)).id)
        time.sleep(0.001)
    order = [job.id for _ in ids if (job := claim_next(ledger, Queue.SMALL, 60))]
    assert order == [ids[2], ids[1], ids[3], ids[0]]
    assert claim_next(ledger, Queue.SMALL, 60) is None


def test_queues_do_not_mix(ledger: Ledger) -> None:
    send(ledger, "acme", queue=Queue.LARGE)
    assert started(ledger, 1) == []
    assert started(ledger, 2, Queue.LARGE) == [("acme", NORMAL)]


def test_a_job_that_was_given_back_is_its_tenants_next_one(ledger: Ledger) -> None:
    send(ledger, "acme", jobs=3)
    first = claim_next(ledger, Queue.SMALL, 60)
    assert first is not None
    assert ledger.release(first.lease)
    again = claim_next(ledger, Queue.SMALL, 60)
    assert again is not None
    assert again.id == first.id


def test_workers_that_ask_at_once_get_a_job_each_and_no_job_twice(ledger: Ledger) -> None:
    for tenant in "abcd":
        send(ledger, tenant, jobs=5)
    barrier = threading.Barrier(6)

    def work(_: int) -> list[str]:
        barrier.wait()
        return [job.id for _ in range(4) if (job := claim_next(ledger, Queue.SMALL, 60))]

    with ThreadPoolExecutor(6) as pool:
        ids = [job_id for mine in pool.map(work, range(6)) for job_id in mine]
    assert len(ids) == len(set(ids)) == 20


def steps(ledger: Ledger, ask: Callable[[], object]) -> int:
    """The instructions that SQLite's virtual machine takes for what is asked."""
    taken: list[None] = []

    def count(connection: Connection) -> None:
        driver: Any = connection.connection.driver_connection
        driver.set_progress_handler(lambda: taken.append(None), 1)

    event.listen(ledger.sessions.kw["bind"], "engine_connect", count)
    ask()
    return len(taken)


def test_of_ten_thousand_that_wait_the_next_is_found_without_reading_them_all(tmp_path: Path) -> None:
    """PostgreSQL's plans are looked at in `test_query_plans.py`."""
    ledger = Ledger(f"sqlite:///{tmp_path / 'ledger.sqlite3'}")
    row = {"tenant_id": "busy", "state": JobState.QUEUED, "filename": "a", "parameters": {}, "enqueued_at": now()}
    with ledger.sessions.begin() as session:
        rows = [{**row, "id": f"{number:036}", "created_at": now()} for number in range(10_000)]
        session.execute(insert(Job), rows)
    send(ledger, "late")
    assert next_job(ledger.sessions, Queue.SMALL)
    assert steps(ledger, lambda: next_job(ledger.sessions, Queue.SMALL)) < 1000


def test_a_job_tells_its_queue_and_one_that_is_not_there_none(ledger: Ledger) -> None:
    job = ledger.create("a", {}, {}, lambda _: True, Submission(queue=Queue.GPU))
    assert queue_of(ledger.sessions, job.id) == Queue.GPU
    assert queue_of(ledger.sessions, "unknown") is None
