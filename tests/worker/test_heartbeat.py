from datetime import datetime, timedelta
from pathlib import Path

from sqlalchemy import update
from structlog.testing import capture_logs

from service.jobs.clock import now
from service.jobs.dead import WORKER_LOST
from service.jobs.ledger import Ledger
from service.jobs.models import Job
from tests.service.postgres import Postgres, postgres_server
from tests.worker.waiting import PATIENCE, wait_until
from worker.heartbeat import Heartbeat


def claimed(ledger: Ledger, lease_seconds: float) -> Job:
    job = ledger.claim(ledger.create("asset.glb", {}, {}, lambda _: True).id, lease_seconds)
    assert job is not None
    return job


def stage(ledger: Ledger, job: Job) -> str | None:
    now = ledger.get(job.id)
    assert now is not None
    return now.stage


def expiry(ledger: Ledger, job: Job) -> datetime:
    """The moment until which the worker holds its job."""
    found = ledger.get(job.id)
    assert found is not None
    assert found.lease_expires_at is not None
    return found.lease_expires_at


def expired(ledger: Ledger, job: Job) -> None:
    """As if the lease had just run out."""
    with ledger.sessions.begin() as session:
        session.execute(update(Job).where(Job.id == job.id).values(lease_expires_at=now() - timedelta(seconds=1)))


def test_a_lease_is_kept_for_as_long_as_the_work_goes_on(tmp_path: Path) -> None:
    ledger = Ledger(f"sqlite:///{tmp_path / 'ledger.sqlite3'}")
    job = claimed(ledger, 60)
    with Heartbeat(ledger, job.lease, 60) as heartbeat:
        for _ in range(2):
            expired(ledger, job)
            wait_until(lambda: expiry(ledger, job) > now())
            assert ledger.recover(1, WORKER_LOST) == ([], [])
        assert not heartbeat.lost.is_set()
    expired(ledger, job)
    assert ledger.recover(1, WORKER_LOST) == ([], [job.id])
    ledger.close()


def test_a_new_stage_shows_at_once_and_a_cancellation_is_noticed(tmp_path: Path) -> None:
    ledger = Ledger(f"sqlite:///{tmp_path / 'ledger.sqlite3'}")
    job = claimed(ledger, 60)
    with Heartbeat(ledger, job.lease, 60) as heartbeat:
        wait_until(lambda: stage(ledger, job) == "reading")
        heartbeat.at("placing", 0.5)
        wait_until(lambda: stage(ledger, job) == "placing")
        ledger.cancel(job.id)
        assert heartbeat.lost.wait(PATIENCE)
    ledger.close()


def test_a_database_that_is_restarted_costs_no_lease_and_one_that_stays_away_does() -> None:
    with postgres_server() as server:
        ledger = Ledger(server.new_database())
        job = claimed(ledger, PATIENCE)
        with Heartbeat(ledger, job.lease, PATIENCE) as heartbeat, capture_logs() as logs:
            server.stop()
            wait_until(lambda: "the job ledger does not answer" in [entry["event"] for entry in logs])
            server.start()
            back = now()
            wait_until(lambda: expiry(ledger, job) > back + timedelta(seconds=PATIENCE))
            assert not heartbeat.lost.is_set()
            assert ledger.recover(1, WORKER_LOST) == ([], [])
        with Heartbeat(ledger, job.lease, 1) as heartbeat:
            wait_until(lambda: expiry(ledger, job) < back + timedelta(seconds=PATIENCE))
            server.stop()
            assert heartbeat.lost.wait(PATIENCE)
        ledger.close()


def test_a_heart_that_stops_for_whatever_reason_is_noticed(postgres: Postgres) -> None:
    """Here for a stage that the ledger does not take, as an engine that was taken over may name one."""
    ledger = Ledger(postgres.new_database())
    job = claimed(ledger, 60)
    with Heartbeat(ledger, job.lease, 60) as heartbeat:
        heartbeat.at("x" * 100, 0.5)
        assert heartbeat.lost.wait(PATIENCE)
    ledger.close()
