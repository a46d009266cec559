"""A worker that was only thought dead, with real processes and a real Redis: what it makes is not published."""

import os
import signal
import sys
import time
from pathlib import Path

from service.config import Settings
from service.jobs.ledger import Ledger
from service.jobs.references import unreferenced
from service.jobs.stores import open_store
from tests.service.harness import API_COMMAND, Service, redis_server, running
from tests.worker.waiting import wait_until

WORKER = [sys.executable, "-m", "tests.worker.apps"]


def test_a_worker_that_sleeps_through_its_lease_changes_nothing_when_it_wakes(tmp_path: Path) -> None:
    go = tmp_path / "go"
    with redis_server(tmp_path) as broker:
        service = Service(tmp_path, broker_url=broker, lease_seconds="5")
        with service.running(API_COMMAND, WORKER) as (_, first):
            url = service.start_job(wait_for=os.fspath(go), sign=True)
            wait_until(lambda: service.job(url)["stage"] == "placing")
            first.send_signal(signal.SIGSTOP)  # its child goes on: it writes its model as soon as it may
            with running(WORKER, service.environment):
                wait_until(lambda: service.job(url)["attempts"] == 2)
                go.touch()
                done = service.wait_for(url, "succeeded")
                model = service.client.get(done["links"]["model"]).content
                first.send_signal(signal.SIGCONT)
                other = service.start_job(number=1)
                service.wait_for(other, "succeeded")
                time.sleep(2)
            assert service.job(url) == done
            assert service.client.get(done["links"]["model"]).content == model
            assert first.poll() is None
        ledger = Ledger(f"sqlite:///{tmp_path / 'data' / 'ledger.sqlite3'}")
        stored = {item.sha256 for item in open_store(Settings(data_dir=tmp_path / "data")).listing()}
        assert unreferenced(ledger.sessions, stored) == set()
        ledger.close()
