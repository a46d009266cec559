"""Workers as processes, for some queues each, with a real Redis between."""

import os
import sys
from pathlib import Path

from service.jobs.ledger import Ledger
from service.jobs.tenants import Scope, create_key
from tests.service.harness import API_COMMAND, Service, redis_server, running
from tests.worker.engines import asset
from tests.worker.waiting import wait_until

SMALL_ONLY = [sys.executable, "-m", "tests.worker.apps", "--queues", "small"]
LARGE_AND_GPU = [sys.executable, "-m", "tests.worker.apps", "--queues", "large,gpu"]


def test_a_worker_serves_the_queues_it_is_told_and_no_other(tmp_path: Path) -> None:
    with redis_server(tmp_path) as broker:
        service = Service(tmp_path, broker_url=broker, large_asset_bytes="1000", gpu_asset_bytes="100000")
        with service.running(API_COMMAND, SMALL_ONLY):
            large, gpu = (service.submit(asset() + b"#" * size + b"\n").headers["Location"] for size in (1000, 100000))
            service.wait_for(service.start_job(), "succeeded")
            assert [service.job(url)["state"] for url in (large, gpu)] == ["queued", "queued"]
            with running(LARGE_AND_GPU, service.environment):
                for url in (large, gpu):
                    assert service.wait_for(url, "succeeded")["attempts"] == 1


def test_a_tenant_who_comes_late_does_not_wait_for_all_jobs_of_another(tmp_path: Path) -> None:
    """One place, taken; ten jobs of one tenant wait, and then one of another comes."""
    with redis_server(tmp_path) as broker:
        service, go = Service(tmp_path, broker_url=broker, auth="keys"), tmp_path / "go"
        ledger = Ledger(f"sqlite:///{tmp_path / 'data' / 'ledger.sqlite3'}")
        keys = {tenant: create_key(ledger.sessions, tenant, "test", [*Scope]).text for tenant in ("busy", "late")}
        with service.running(API_COMMAND, SMALL_ONLY):

            def start_job(tenant: str, **details: str) -> str:
                service.client.headers["Authorization"] = f"Bearer {keys[tenant]}"
                return service.start_job(**details)

            first = start_job("busy", wait_for=os.fspath(go))
            wait_until(lambda: service.job(first)["stage"] == "placing")
            busy = [start_job("busy") for _ in range(10)]
            late = start_job("late")
            go.touch()
            began = service.wait_for(late, "succeeded")["started_at"]
            service.client.headers["Authorization"] = f"Bearer {keys['busy']}"
            others = [service.wait_for(url, "succeeded")["started_at"] for url in busy]
            assert sum(moment < began for moment in others) == 0
        ledger.close()
