from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime

import pytest
from sqlalchemy.orm import Session

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs import limits
from service.jobs.ledger import Ledger, Submission
from service.jobs.limits import check_active, spend
from service.jobs.tenants import Scope, create_key


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


@dataclass
class Clock:
    """The time by which buckets fill: it stands still until a test moves it."""

    now: float = 1e9

    def __call__(self, _session: Session) -> datetime:
        return datetime.fromtimestamp(self.now, UTC)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(limits, "clock", clock)
    return clock


def new_key(ledger: Ledger) -> str:
    return create_key(ledger.sessions, "acme", "a key", Scope).row.id


def submit(ledger: Ledger, tenant: str, most: int) -> str | None:
    """The id of a new job of a tenant, if one more is allowed."""
    submission = Submission(tenant, condition=lambda session, _: check_active(session, tenant, most))
    try:
        return ledger.create("asset.glb", {}, {}, lambda _: True, submission).id
    except MeshmarkError as error:
        if error.code != ServiceErrorCode.TOO_MANY_JOBS:
            raise
        return None


def test_a_minutes_requests_may_come_at_once_and_then_one_by_one(ledger: Ledger, clock: Clock) -> None:
    key = new_key(ledger)
    waits = [spend(ledger.sessions, key, 240) for _ in range(241)]
    assert waits == [0.0] * 240 + [0.25]
    clock.now += 0.24
    assert spend(ledger.sessions, key, 240) == pytest.approx(0.01, abs=1e-3)
    clock.now += 0.02
    assert spend(ledger.sessions, key, 240) == 0


@pytest.mark.usefixtures("clock")
def test_of_many_processes_that_share_a_key_all_together_get_its_requests(ledger: Ledger, database_url: str) -> None:
    key, ledgers = new_key(ledger), [ledger, Ledger(database_url)]
    with ThreadPoolExecutor(8) as pool:
        waits = list(pool.map(lambda number: spend(ledgers[number % 2].sessions, key, 10), range(30)))
    ledgers[1].close()
    assert sum(wait == 0 for wait in waits) == 10
    assert all(0 < wait <= 6 for wait in waits if wait)


@pytest.mark.usefixtures("clock")
def test_each_key_has_a_bucket_of_its_own(ledger: Ledger) -> None:
    first, second = new_key(ledger), new_key(ledger)
    assert spend(ledger.sessions, first, 1) == 0
    assert 59 < spend(ledger.sessions, first, 1) <= 60
    assert spend(ledger.sessions, second, 1) == 0


def test_a_tenant_has_so_many_jobs_at_a_time_and_others_their_own(ledger: Ledger) -> None:
    new_key(ledger)
    first, second = submit(ledger, "acme", 2), submit(ledger, "acme", 2)
    assert first is not None
    assert second is not None
    assert submit(ledger, "acme", 2) is None
    assert submit(ledger, "default", 2) is not None
    ledger.claim(first, 60)
    assert submit(ledger, "acme", 2) is None
    ledger.cancel(first, "acme")
    assert submit(ledger, "acme", 2) is not None


def test_of_many_requests_for_the_last_places_no_more_get_one_than_there_are(ledger: Ledger, database_url: str) -> None:
    new_key(ledger)
    ledgers = [ledger, Ledger(database_url)]
    with ThreadPoolExecutor(8) as pool:
        jobs = list(pool.map(lambda number: submit(ledgers[number % 2], "acme", 5), range(24)))
    ledgers[1].close()
    assert sum(job is not None for job in jobs) == 5
    assert len(ledger.waiting(-1)) == 5
