"""`python -m service api` and `celery -A worker.app worker` as processes of their own, with a real Redis between.

Once they share a folder with ledger and artifacts, as on one machine; once a PostgreSQL and a bucket and no folder, as
on many.
"""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from service.config import Settings
from service.jobs import queue
from service.jobs.models import Queue
from tests.service.harness import API_COMMAND, WORKER_COMMAND, Service, redis_server, running
from tests.service.s3 import Bucket
from tests.worker.waiting import gone, wait_until


@pytest.fixture(scope="module", params=["a folder", "servers"])
def service(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder, worker = tmp_path_factory.mktemp("distributed"), [*WORKER_COMMAND, "--hostname=first@test"]
    shared = {}
    if request.param == "servers":
        bucket: Bucket = request.getfixturevalue("s3").new_bucket()
        shared = {"database_url": request.getfixturevalue("postgres").new_database(), **bucket.settings}
        worker = elsewhere(folder, worker)
    with redis_server(folder) as broker:
        service = Service(folder, broker_url=broker, **shared)
        with service.running(API_COMMAND, worker):
            yield service


def elsewhere(folder: Path, command: list[str]) -> list[str]:
    """A command with a data folder of its own."""
    return ["env", f"MESHMARK_DATA_DIR={folder / 'another machine'}", *command]


def settings(service: Service) -> Settings:
    return Settings(broker_url=service.environment["MESHMARK_BROKER_URL"])


def test_an_asset_goes_in_and_model_report_and_preview_come_out(service: Service) -> None:
    job = service.wait_for(service.start_job(), "succeeded")
    assert service.client.get(job["links"]["model"]).content == b"glTF of HI"
    assert service.client.get(job["links"]["report"]).json()["text"] == "HI"
    assert service.client.get(job["links"]["preview"]).content == b"\x89PNG"


def test_a_message_that_arrives_again_changes_nothing(service: Service) -> None:
    url = service.start_job()
    before = service.wait_for(url, "succeeded")
    client = queue.create_queue(settings(service))
    for _ in range(3):
        queue.send(client, before["id"], Queue.SMALL)
    queue.send(client, "00000000-0000-0000-0000-000000000000", Queue.SMALL)
    other = service.wait_for(service.start_job(), "succeeded")
    client.close()
    assert other["attempts"] == 1
    assert service.job(url) == before


def test_a_job_survives_kill_9_of_its_worker(service: Service, tmp_path: Path) -> None:
    go = tmp_path / "go"
    url = service.start_job(wait_for=os.fspath(go))
    wait_until(lambda: service.job(url)["stage"] == "placing")
    worker = worker_process()
    family = worker.children(recursive=True)
    assert len(family) == 2  # the template and the engine's process
    worker.send_signal(signal.SIGKILL)
    wait_until(lambda: all(map(gone, family)))
    go.touch()
    second = [*WORKER_COMMAND, "--hostname=second@test"]
    if "MESHMARK_STORE_URL" in service.environment:
        second = elsewhere(tmp_path, second)
    with running(second, service.environment):
        assert service.wait_for(url, "succeeded")["attempts"] == 2


def worker_process() -> psutil.Process:
    for process in psutil.Process().children(recursive=True):
        if not gone(process) and "--hostname=first@test" in process.cmdline():
            return process
    raise AssertionError("there is no worker")


def test_jobs_sent_while_the_broker_is_down_run_once_it_is_back(tmp_path: Path) -> None:
    with redis_server(tmp_path) as broker:
        pass
    service = Service(tmp_path, broker_url=broker)
    port = int(broker.rsplit(":", 1)[1].removesuffix("/0"))
    with service.running(API_COMMAND):
        url = service.start_job()
        assert service.job(url)["state"] == "queued"
        with redis_server(tmp_path, port), running(WORKER_COMMAND, service.environment):
            assert service.wait_for(url, "succeeded")["attempts"] == 1
