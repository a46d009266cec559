"""Machines whose clocks differ share a ledger on a server: what they compare are moments of its clock."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import datetime, timedelta, tzinfo
from typing import Self

import pytest
from sqlalchemy.orm import Session

from core.errors import MeshmarkError
from service.jobs import clock, dropped, idempotency
from service.jobs.dead import WORKER_LOST
from service.jobs.ledger import Ledger, Submission
from service.jobs.limits import spend
from service.jobs.models import Queue
from service.jobs.tenants import Scope, create_key
from service.webhooks import deliveries
from service.webhooks.endpoints import create_endpoint
from tests.service.postgres import Postgres

HOUR = timedelta(hours=1)


@pytest.fixture
def ledger(postgres: Postgres) -> Iterator[Ledger]:
    with closing(Ledger(postgres.new_database())) as ledger:
        yield ledger


@contextmanager
def another_machine(skew: timedelta) -> Iterator[None]:
    """What happens in the block happens on a machine whose clock is wrong."""

    class Skewed(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> Self:
            return super().now(tz) + skew

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clock, "datetime", Skewed)
        yield


@pytest.mark.parametrize("skew", [HOUR, -HOUR])
def test_a_lease_holds_and_ends_whatever_the_clocks_of_worker_and_sweeper(ledger: Ledger, skew: timedelta) -> None:
    job_id = ledger.create("asset.glb", {}, {}, lambda _: True).id
    with another_machine(skew):
        job = ledger.claim(job_id, 60)
        assert job is not None
        assert ledger.heartbeat(job.lease, 60, "placing", 0.5)
    assert ledger.recover(2, WORKER_LOST) == ([], [])
    with another_machine(-skew):
        assert ledger.recover(2, WORKER_LOST) == ([], [])
        assert ledger.heartbeat(job.lease, 0, "placing", 0.6)
    with another_machine(skew):
        assert ledger.recover(2, WORKER_LOST) == ([job_id], [])
        assert ledger.waiting(60, Queue.SMALL) == []
        assert ledger.waiting(0, Queue.SMALL) == [job_id]


@pytest.mark.parametrize("skew", [HOUR, -HOUR])
def test_whoever_holds_a_webhook_a_key_or_an_object_holds_it_on_all_machines(ledger: Ledger, skew: timedelta) -> None:
    def drop(session: Session, job_id: str) -> None:
        dropped.record(session, job_id, "object", "source", "key")

    create_endpoint(ledger.sessions, "default", "https://shop.example/", ["watermark.canceled"], None)
    with another_machine(skew):
        assert ledger.cancel(ledger.create("a.glb", {}, {}, lambda _: True, Submission(condition=drop)).id)
    [delivery_id] = deliveries.announce(ledger.sessions, lost=False)
    with another_machine(skew):
        assert deliveries.announce(ledger.sessions, lost=True) == []
        assert deliveries.claim(ledger.sessions, delivery_id)
        assert dropped.take_due(ledger.sessions, "source")
        reserved = idempotency.reserve(ledger.sessions, "default", "key", "print")
        assert isinstance(reserved, idempotency.Reservation)
    assert deliveries.claim(ledger.sessions, delivery_id) is None
    assert dropped.take_due(ledger.sessions, "source") is None
    with pytest.raises(MeshmarkError, match="idempotency_key_in_use"):
        idempotency.reserve(ledger.sessions, "default", "key", "print")


def test_a_machine_that_is_ahead_spends_no_requests_of_the_others(ledger: Ledger) -> None:
    key = create_key(ledger.sessions, "acme", "a key", Scope).row.id
    with another_machine(HOUR):
        assert spend(ledger.sessions, key, 60) == 0
    assert spend(ledger.sessions, key, 60) == 0
