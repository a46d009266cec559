import time
from pathlib import Path

from service.jobs.ledger import WORKER_LOST, Ledger
from service.jobs.models import Job
from tests.service.postgres import Postgres, postgres_server
from tests.worker.waiting import wait_until
from worker.heartbeat import Heartbeat


def claimed(ledger: Ledger, lease_seconds: float) -> Job:
    job = ledger.claim(ledger.create("asset.glb", {}, {}, lambda _: True).id, lease_seconds)
    assert job is not None
    return job


def stage(ledger: Ledger, job: Job) -> str | None:
    now = ledger.get(job.id)
    assert now is not None
    return now.stage


def test_a_lease_is_kept_for_as_long_as_the_work_goes_on(tmp_path: Path) -> None:
    ledger = Ledger(f"sqlite:///{tmp_path / 'ledger.sqlite3'}")
    job = claimed(ledger, 0.5)
    with Heartbeat(ledger, job.lease, 0.5) as heartbeat:
        time.sleep(1)
        assert ledger.recover(1, WORKER_LOST) == ([], [])
        assert not heartbeat.lost.is_set()
    time.sleep(0.6)
    assert ledger.recover(1, WORKER_LOST) == ([], [job.id])
    ledger.close()


def test_a_new_stage_shows_at_once_and_a_cancellation_is_noticed(tmp_path: Path) -> None:
    ledger = Ledger(f"sqlite:///{tmp_path / 'ledger.sqlite3'}")
    job = claimed(ledger, 60)
    with Heartbeat(ledger, job.lease, 60) as heartbeat:
        wait_until(lambda: stage(ledger, job) == "reading")
        heartbeat.at("placing", 0.5)
        wait_until(lambda: stage(ledger, job) == "placing", 0.5)
        ledger.cancel(job.id)
        assert heartbeat.lost.wait(5)
    ledger.close()


def test_a_database_that_is_restarted_costs_no_lease_and_one_that_stays_away_does() -> None:
    with postgres_server() as server:
        ledger = Ledger(server.new_database())
        job = claimed(ledger, 4)
        with Heartbeat(ledger, job.lease, 4) as heartbeat:
            server.stop()
            time.sleep(0.5)
            server.start()
            assert not heartbeat.lost.wait(2)
            assert ledger.recover(1, WORKER_LOST) == ([], [])
            server.stop()
            assert heartbeat.lost.wait(10)
        ledger.close()


def test_a_heart_that_stops_for_whatever_reason_is_noticed(postgres: Postgres) -> None:
    """Here for a stage that the ledger does not take, as an engine that was taken over may name one."""
    ledger = Ledger(postgres.new_database())
    job = claimed(ledger, 60)
    with Heartbeat(ledger, job.lease, 60) as heartbeat:
        heartbeat.at("x" * 100, 0.5)
        assert heartbeat.lost.wait(5)
    ledger.close()
