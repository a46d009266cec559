"""Servers that fail while jobs run, with real processes: nothing is lost, nothing runs twice, nothing stays behind."""

import time
from pathlib import Path

from service.jobs.ledger import Ledger
from service.jobs.references import unreferenced
from service.jobs.stores import open_store
from tests.service.harness import API_COMMAND, WORKER_COMMAND, Service, redis_server
from tests.service.postgres import postgres_server
from tests.service.s3 import S3, Flaky, bucket_settings
from tests.worker.waiting import wait_until

JOBS = 12


def test_every_accepted_job_ends_once_though_database_and_store_fail_meanwhile(s3: S3, tmp_path: Path) -> None:
    with postgres_server() as database, redis_server(tmp_path) as broker, Flaky(s3.url).running() as flaky:
        bucket, url = s3.new_bucket(), database.new_database()
        bucket.endpoint = flaky.url
        service = Service(
            tmp_path, broker_url=broker, database_url=url, lease_seconds="20", worker_concurrency="2", **bucket.settings
        )
        with service.running(API_COMMAND, WORKER_COMMAND):
            accepted = [service.start_job(number=number) for number in range(JOBS)]
            flaky.failing.set()
            refused = service.submit()
            assert (refused.status_code, refused.json()["code"]) == (503, "service_unavailable")
            time.sleep(1)
            flaky.failing.clear()
            database.stop()
            refused = service.client.get(accepted[0])
            assert (refused.status_code, refused.json()["code"], refused.headers["Retry-After"]) == (
                503,
                "service_unavailable",
                "5",
            )
            time.sleep(1)
            database.start()
            wait_until(lambda: service.client.get("/readyz").status_code == 200)
            for job_url in accepted:
                job = service.wait_for(job_url, "succeeded")
                assert job["attempts"] == 1
                assert service.client.get(f"{job_url}/model").content == b"glTF of HI"
        ledger, store = Ledger(url), open_store(bucket_settings(bucket, tmp_path))
        stored = {item.sha256 for item in store.listing()}
        assert ledger.running() == set()
        # An input and a plan of each; model, report and preview are the same for all.
        assert len(stored) == 2 * JOBS + 3
        assert unreferenced(ledger.sessions, stored) == set()
        ledger.close()
        assert list((tmp_path / "data" / "scratch").iterdir()) == []
