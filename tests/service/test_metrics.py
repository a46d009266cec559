"""Metrics of real API and worker processes, as Prometheus reads them."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest
from prometheus_client import Metric

from service.config import Settings
from service.metrics import metrics_server
from tests.service.harness import (
    API_COMMAND,
    EMBEDDED_COMMAND,
    WORKER_COMMAND,
    Service,
    free_port,
    redis_server,
    running,
)
from tests.service.metrics import label_values, scrape, value
from tests.service.postgres import Postgres
from tests.worker.engines import asset
from tests.worker.waiting import PATIENCE, wait_until


class Fleet:
    """Two APIs and two workers on one PostgreSQL, each with its own figures."""

    def __init__(self, service: Service, second: Service, ports: list[int]) -> None:
        self.service, self.second, self.ports = service, second, ports

    def scrape(self) -> list[Metric]:
        """The figures of all four, as Prometheus has them."""
        return [family for port in self.ports for family in scrape(port)]


@pytest.fixture
def fleet(postgres: Postgres, tmp_path: Path) -> Iterator[Fleet]:
    ports = [free_port() for _ in range(4)]
    with redis_server(tmp_path) as broker, ExitStack() as stack:
        shared = {"broker_url": broker, "database_url": postgres.new_database()}
        services = [Service(tmp_path, metrics_port=str(port), **shared) for port in ports[:2]]
        for number, port in enumerate(ports[2:]):
            command = ["env", f"MESHMARK_WORKER_METRICS_PORT={port}", *WORKER_COMMAND, f"--hostname={number}@test"]
            stack.enter_context(running(command, services[0].environment))
        for service in services:
            stack.enter_context(service.running(API_COMMAND))
        yield Fleet(services[0], services[1], ports)


def test_the_figures_of_all_processes_add_up_to_what_happened(fleet: Fleet, tmp_path: Path) -> None:
    go = tmp_path / "go"
    held = [fleet.service.start_job(wait_for=os.fspath(go)) for _ in range(2)]
    waiting = [fleet.second.start_job(number=number) for number in range(5)]
    refusing = fleet.service.start_job("refuse")
    wait_until(lambda: value(fleet.scrape(), "meshmark_jobs", state="running") == 4)  # two, seen by each API
    for port in fleet.ports[:2]:
        figures = scrape(port)
        assert value(figures, "meshmark_ledger_up") == 1
        assert value(figures, "meshmark_jobs", state="queued") == 6
        assert value(figures, "meshmark_queue_oldest_seconds") > 0
    canceled = fleet.second.client.delete(waiting.pop())
    assert canceled.status_code == 204
    go.touch()
    for url in [*held, *waiting]:
        fleet.service.wait_for(url, "succeeded")
    fleet.service.wait_for(refusing, "failed")
    wait_until(lambda: value(fleet.scrape(), "meshmark_job_seconds_count") == 7)
    figures = fleet.scrape()
    assert value(figures, "meshmark_jobs") == 0
    assert value(figures, "meshmark_queue_oldest_seconds") == 0
    assert value(figures, "meshmark_jobs_accepted_total") == 8
    assert value(figures, "meshmark_jobs_ended_total", state="succeeded") == 6
    assert value(figures, "meshmark_jobs_ended_total", state="failed", code="no_placement") == 1
    assert value(figures, "meshmark_jobs_ended_total", state="canceled") == 1
    assert value(figures, "meshmark_job_wait_seconds_count") == 7
    assert value(figures, "meshmark_stage_seconds_count", stage="placing") == 7
    assert value(figures, "meshmark_stage_seconds_count", stage="evaluating") == 6
    assert value(figures, "meshmark_artifact_bytes_total", kind="model") == 6 * len("glTF of HI")
    assert value(figures, "meshmark_artifact_bytes_total", kind="input") > 7 * len(asset()) - 70


def test_requests_are_counted_by_the_template_of_their_route_and_by_nothing_a_client_makes_up(tmp_path: Path) -> None:
    port = free_port()
    service = Service(tmp_path, metrics_port=str(port))
    with service.running(EMBEDDED_COMMAND):
        client, url = service.client, service.start_job()
        service.wait_for(url, "succeeded")
        for number, method in enumerate(("COPY", "LOCK", "MKCOL", "PURGE", "REPORT")):
            assert client.get(f"/v1/watermarks/nobody-{number}").status_code == 404
            assert client.get(f"/nothing-{number}").status_code == 404
            assert client.request(method, "/healthz").status_code == 405
            assert client.request(f"INVENTED{number}", "/healthz").status_code == 400
        model = client.get(f"{url}/model").content
        figures = scrape(port)
    count = "meshmark_http_requests_total"
    assert value(figures, count, route="/v1/watermarks", method="POST", status="202") == 1
    assert value(figures, count, route="/v1/watermarks/{job_id}", method="GET", status="404") == 5
    assert value(figures, count, route="other", status="404") == 5
    assert value(figures, count, method="other", status="405") == 5
    assert value(figures, "meshmark_problems_total", code="not_found") == 10
    size = "meshmark_http_bytes_total"
    assert value(figures, size, direction="out", route="/v1/watermarks/{job_id}/model") == len(model)
    assert value(figures, size, direction="in", route="/v1/watermarks") > len(asset())
    latency = "meshmark_http_request_seconds_count"
    assert value(figures, latency, route="/v1/watermarks/{job_id}/model", method="GET") == 1
    assert not [text for text in label_values(figures, "route") | label_values(figures, "method") if "nobody" in text]
    assert not [text for text in label_values(figures, "method") if "INVENTED" in text or text in ("COPY", "LOCK")]


def test_without_a_port_nothing_is_served_and_with_one_only_on_its_address(tmp_path: Path) -> None:
    listening = Service(tmp_path)
    with listening.running(API_COMMAND) as (process,):
        ports = {item.laddr.port for item in psutil.Process(process.pid).net_connections() if item.status == "LISTEN"}
        assert ports == {int(listening.url.rpartition(":")[2])}
        assert listening.client.get("/metrics").status_code == 404
    port = free_port()
    with metrics_server(Settings().metrics_host, port):
        addresses = [item.laddr for item in psutil.Process().net_connections() if item.laddr.port == port]
        assert [item.ip for item in addresses] == ["127.0.0.1"]


@pytest.mark.parametrize("command", [API_COMMAND, WORKER_COMMAND])
def test_a_port_that_is_taken_stops_the_process_with_a_line_that_says_so(command: list[str], tmp_path: Path) -> None:
    port = free_port()
    settings = {
        "METRICS_PORT": str(port),
        "WORKER_METRICS_PORT": str(port),
        "DATA_DIR": os.fspath(tmp_path),
        "PORT": "0",
    }
    environment = os.environ | {f"MESHMARK_{name}": text for name, text in settings.items()}
    with metrics_server("127.0.0.1", port):
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode != 0
    assert "the port of the metrics cannot be opened" in done.stderr
