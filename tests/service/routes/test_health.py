"""Health probes, with real servers that stop and start again behind a real API process."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from service.jobs.artifacts import StoreUnavailableError
from service.jobs.stores import open_store
from tests.service.conftest import Client
from tests.service.harness import API_COMMAND, Service, redis_server
from tests.service.postgres import postgres_server
from tests.service.s3 import S3, Bucket, Flaky, bucket_settings
from tests.worker.waiting import wait_until


def test_a_service_with_all_its_parts_lives_and_is_ready(client: Client) -> None:
    assert client.http.get("/healthz").json() == {"status": "ok"}
    response = client.http.get("/readyz")
    assert (response.status_code, response.json()) == (200, {"status": "ready"})


def test_readiness_names_what_stopped_and_comes_back_with_it_while_the_process_lives_on(s3: S3, tmp_path: Path) -> None:
    with postgres_server() as database, Flaky(s3.url).running() as flaky, ExitStack() as first:
        broker = first.enter_context(redis_server(tmp_path))
        bucket, url = s3.new_bucket(), database.new_database()
        bucket.endpoint = flaky.url
        service = Service(tmp_path, broker_url=broker, database_url=url, **bucket.settings)
        with service.running(API_COMMAND):
            wait_until(lambda: failing(service) == "")
            flaky.failing.set()
            wait_until(lambda: failing(service) == "store")
            flaky.failing.clear()
            wait_until(lambda: failing(service) == "")
            database.stop()
            wait_until(lambda: failing(service) == "ledger")
            first.close()
            wait_until(lambda: failing(service) == "ledger, broker")
            assert service.client.get("/healthz").status_code == 200
            database.start()
            with redis_server(tmp_path, int(broker.rsplit(":", 1)[1].removesuffix("/0"))):
                wait_until(lambda: failing(service) == "")


def failing(service: Service) -> str:
    """What the service says does not answer."""
    response = service.client.get("/readyz")
    if response.status_code == 200:
        return ""
    assert (response.status_code, response.json()["code"]) == (503, "service_unavailable")
    assert response.headers["Retry-After"] == "5"
    detail = str(response.json()["detail"])
    assert "127.0.0.1" not in detail, "nothing of the inside"
    return detail.removesuffix(".").rpartition(": ")[2]


def test_a_bucket_that_is_not_there_is_no_store(s3: S3, tmp_path: Path) -> None:
    open_store(bucket_settings(s3.new_bucket(), tmp_path)).ping()
    store = open_store(bucket_settings(Bucket(s3.url, "nobody-made-this-bucket"), tmp_path))
    with pytest.raises(StoreUnavailableError):
        store.ping()


def test_a_folder_that_takes_no_files_is_no_store(client: Client) -> None:
    client.artifacts.ping()
    root = client.worker.settings.data_dir / "artifacts"
    root.rename(root.with_name("elsewhere"))
    with pytest.raises(StoreUnavailableError):
        client.artifacts.ping()
    response = client.http.get("/readyz")
    assert (response.status_code, response.json()["detail"].rpartition(": ")[2]) == (503, "store.")
