"""`python -m worker.webhooks` as a process of its own, which sends what an API process has noted to real receivers."""

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

import psutil
import pytest
from sqlalchemy import update

from service.config import Settings
from service.jobs.clock import now
from service.jobs.events import ENDINGS
from service.jobs.ledger import Ledger
from service.jobs.models import WebhookDelivery, WebhookEndpoint
from service.jobs.queue import create_queue
from service.webhooks import queue
from service.webhooks.deliveries import LEASE, list_deliveries
from service.webhooks.endpoints import create_endpoint
from tests.service.harness import API_COMMAND, Service, free_port, redis_server, running
from tests.service.webhooks.receiver import Receiver
from tests.worker.waiting import PATIENCE, gone, wait_until
from worker.webhooks import Sender, sweep

SENDER = [sys.executable, "-m", "worker.webhooks"]
EVERYTHING = (
    "import os, sys\n"
    "from service.__main__ import serve\n"
    "from service.config import Settings\n"
    "pid = str(os.getpid())\n"
    "serve(Settings(), *([sys.executable, '-m', name, pid] for name in ('tests.worker.apps', 'worker.webhooks')))"
)
PATH = "/v1/webhook-endpoints"


class Hooked(Service):
    """A service that may call receivers on some ports of loopback."""

    def __init__(self, folder: Path, **settings: str) -> None:
        self.ports = [free_port() for _ in range(16)]
        allowed = {
            "outbound_networks": "127.0.0.0/8",
            "outbound_http": "true",
            "outbound_ports": ",".join(map(str, self.ports)),
        }
        super().__init__(folder, **allowed, **settings)

    def receiver(self, *answers: int) -> Receiver:
        return Receiver(self.ports.pop(), answers=list(answers))

    def hook(self, receiver: Receiver) -> str:
        """The address of a new endpoint for a receiver, which then knows its secret."""
        response = self.client.post(PATH, json={"url": receiver.url})
        assert response.status_code == 201, response.text
        receiver.secret = response.json()["secret"]
        return str(response.headers["Location"])

    def end_a_job(self) -> str:
        """The id of a job that was canceled, which takes no worker."""
        url = self.start_job()
        assert self.client.delete(url).status_code == 204
        return url.rsplit("/", 1)[1]

    def log(self, endpoint: str) -> list[dict[str, Any]]:
        return list(self.client.get(f"{endpoint}/deliveries", params={"limit": 100}).json()["items"])

    def states(self, endpoint: str) -> set[str]:
        return {delivery["state"] for delivery in self.log(endpoint)}


@pytest.fixture(scope="module", params=["files", "servers"])
def shared(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hooked]:
    folder = tmp_path_factory.mktemp("webhooks")
    with ExitStack() as stack:
        servers = {}
        if request.param == "servers":
            servers["broker_url"] = stack.enter_context(redis_server(folder))
            servers["database_url"] = request.getfixturevalue("postgres").new_database()
        service = Hooked(folder, **servers)
        with service.running(API_COMMAND, SENDER):
            yield service


@pytest.fixture
def service(shared: Hooked) -> Iterator[Hooked]:
    """The service, without the endpoints of other tests."""
    yield shared
    for endpoint in shared.client.get(PATH).json()["items"]:
        shared.client.delete(f"{PATH}/{endpoint['id']}")


def test_a_receiver_is_told_how_a_job_ended_and_verifies_it(service: Hooked) -> None:
    receiver = service.receiver()
    endpoint = service.hook(receiver)
    with receiver.running():
        job_id = service.end_a_job()
        wait_until(lambda: service.states(endpoint) == {"delivered"})
    [message] = receiver.believed
    assert (message["type"], message["data"]["id"], message["data"]["state"]) == (
        "watermark.canceled",
        job_id,
        "canceled",
    )
    [delivery] = service.log(endpoint)
    assert receiver.ids == [delivery["webhook_id"]]
    assert [attempt["status"] for attempt in delivery["attempts"]] == [200]
    assert delivery["next_attempt_at"] is None


def test_a_receiver_that_was_down_or_failed_is_told_later(service: Hooked) -> None:
    down, failing = service.receiver(), service.receiver(500)
    endpoints = [service.hook(receiver) for receiver in (down, failing)]
    with failing.running():
        service.end_a_job()
        wait_until(lambda: all(service.log(endpoint)[0]["attempts"] for endpoint in endpoints))
        assert service.states(endpoints[0]) == service.states(endpoints[1]) == {"pending"}
        with down.running():
            for endpoint in endpoints:
                wait_until(lambda endpoint=endpoint: service.states(endpoint) == {"delivered"})  # type: ignore[misc]
    first, second = (service.log(endpoint)[0]["attempts"] for endpoint in endpoints)
    assert [attempt["status"] for attempt in first] == [None, 200]
    assert "no connection" in first[0]["error"]
    assert [attempt["status"] for attempt in second] == [500, 200]
    assert len(down.believed) == len(failing.believed) == 1
    assert failing.ids[0] == failing.ids[1], "the same message"


def test_a_receiver_that_is_gone_is_sent_nothing_more(service: Hooked) -> None:
    receiver = service.receiver(410)
    endpoint = service.hook(receiver)
    with receiver.running():
        service.end_a_job()
        wait_until(lambda: service.client.get(endpoint).json()["disabled_reason"] == "gone")
        service.end_a_job()
        [delivery] = service.log(endpoint)
        assert (delivery["state"], delivery["attempts"][0]["status"]) == ("exhausted", 410)
        service.client.patch(endpoint, json={"disabled": False})
        service.client.post(f"{endpoint}/deliveries/{delivery['id']}/redeliver")
        wait_until(lambda: service.states(endpoint) == {"delivered"})
    assert receiver.ids == [delivery["webhook_id"]] * 2


def test_during_a_rotation_who_has_either_secret_verifies(service: Hooked) -> None:
    old, new = service.receiver(), service.receiver()
    endpoint = service.hook(old)
    new.secret = service.client.post(f"{endpoint}/rotate-secret").json()["secret"]
    assert new.secret != old.secret
    for number, receiver in enumerate((old, new), 1):
        service.client.patch(endpoint, json={"url": receiver.url})
        with receiver.running():
            service.end_a_job()
            wait_until(lambda number=number: len(service.log(endpoint)) == number)  # type: ignore[misc]
            wait_until(lambda: service.states(endpoint) == {"delivered"})
        assert len(receiver.believed) == 1


def test_a_receiver_that_does_not_answer_holds_up_no_other(service: Hooked) -> None:
    silent, quick = service.receiver(), service.receiver()
    waiting, served = service.hook(silent), service.hook(quick)
    silent.silent.set()
    with silent.running(), quick.running():
        for _ in range(4):
            service.end_a_job()
        wait_until(lambda: len(quick.believed) == 4)
        assert len(silent.ids) >= 1
        assert service.states(waiting) == {"pending"}
        wait_until(lambda: service.states(served) == {"delivered"})
        silent.silent.clear()
        wait_until(lambda: service.states(waiting) == {"delivered"})


def test_a_jobs_own_webhook_is_signed_with_the_secret_for_those(service: Hooked) -> None:
    receiver = service.receiver()
    response = service.client.post(PATH, json={"url": None})
    receiver.secret = response.json()["secret"]
    with receiver.running():
        parts = {"file": ("asset.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")}
        data = {"params": '{"text": "HI"}', "webhook": receiver.url, "metadata": '{"order": "4711"}'}
        job = service.client.post("/v1/watermarks", files=parts, data=data).json()
        service.client.delete(job["links"]["self"])
        wait_until(lambda: receiver.believed)
    assert receiver.believed[0]["data"]["metadata"] == {"order": "4711"}
    [delivery] = service.log(response.headers["Location"])
    assert delivery["url"] == receiver.url


@contextmanager
def ledger_of(service: Service) -> Iterator[Ledger]:
    ledger = Ledger(f"sqlite:///{service.environment['MESHMARK_DATA_DIR']}/ledger.sqlite3")
    try:
        yield ledger
    finally:
        ledger.close()


def test_a_fault_of_ours_is_an_attempt_that_failed_and_not_one_made_for_ever(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    with create_queue(settings) as broker:
        sender = Sender(settings, broker)
        ledger, sessions = sender.ledger, sender.ledger.sessions
        hook = create_endpoint(sessions, "default", "https://shop.example/", ENDINGS, None)
        with sessions.begin() as session:
            session.execute(update(WebhookEndpoint).values(secret="whsec_none"))
        ledger.cancel(ledger.create("asset.glb", {}, {}, lambda _: True).id)
        sweep(sender, lost=False)
        assert not queue.is_empty(broker)
        for attempt in range(1, 11):
            [delivery] = list_deliveries(sessions, "default", hook.id, None, 10, None).deliveries
            assert (delivery.state, delivery.attempts) == ("pending", attempt - 1)
            with sessions.begin() as session:
                session.execute(update(WebhookDelivery).values(due_at=now()))
            sender.send(delivery.id)
        [delivery] = list_deliveries(sessions, "default", hook.id, None, 10, None).deliveries
        assert (delivery.state, delivery.due_at, len(delivery.log)) == ("exhausted", None, 10)
        assert "could not make" in (delivery.log[0].error or "")
        sender.send("no such delivery")
        ledger.close()


def test_what_ended_while_the_broker_was_away_is_told_as_soon_as_it_is_back_and_empty(tmp_path: Path) -> None:
    with redis_server(tmp_path) as broker:
        pass
    service, port = Hooked(tmp_path, broker_url=broker), int(broker.rsplit(":", 1)[1].removesuffix("/0"))
    with ExitStack() as stack:
        first = stack.enter_context(ExitStack())
        first.enter_context(redis_server(tmp_path, port))
        stack.enter_context(service.running(API_COMMAND, SENDER))
        receiver = service.receiver()
        endpoint = service.hook(receiver)
        stack.enter_context(receiver.running())
        service.end_a_job()
        wait_until(lambda: service.states(endpoint) == {"delivered"})
        first.close()
        for _ in range(3):
            service.end_a_job()
        time.sleep(2)
        assert len(receiver.ids) == 1
        stack.enter_context(redis_server(tmp_path, port))
        wait_until(lambda: service.states(endpoint) == {"delivered"})
        assert len(set(receiver.ids)) == 4


def test_kill_9_in_the_middle_of_an_attempt_loses_nothing(tmp_path: Path) -> None:
    with redis_server(tmp_path) as broker:
        service = Hooked(tmp_path, broker_url=broker)
        with service.running(API_COMMAND, SENDER) as [_, sender]:
            receiver = service.receiver()
            endpoint = service.hook(receiver)
            receiver.silent.set()
            with receiver.running():
                jobs = {service.end_a_job() for _ in range(3)}
                wait_until(lambda: len(receiver.ids) == 3)
                sender.kill()
                sender.wait()
                receiver.silent.clear()
                assert service.states(endpoint) == {"pending"}
                receiver.believed.clear()  # what it said is known to nobody
                with ledger_of(service) as ledger, ledger.sessions.begin() as session:  # as if a minute had gone by
                    session.execute(
                        update(WebhookDelivery).values(
                            due_at=now() - timedelta(seconds=1), announced_at=now() - LEASE - timedelta(seconds=1)
                        )
                    )
                with running(SENDER, service.environment):
                    wait_until(lambda: service.states(endpoint) == {"delivered"})
        assert {message["data"]["id"] for message in receiver.believed} == jobs
        assert sorted(receiver.ids[:3]) == sorted(receiver.ids[3:]), "receivers tell repetitions by the id"


def test_one_command_watermarks_and_sends_webhooks_and_ends_both(tmp_path: Path) -> None:
    service = Hooked(tmp_path)
    with service.running([sys.executable, "-c", EVERYTHING]) as [process]:
        receiver = service.receiver()
        endpoint = service.hook(receiver)
        with receiver.running():
            jobs = [service.start_job().rsplit("/", 1)[1], service.start_job("refuse").rsplit("/", 1)[1]]
            wait_until(lambda: len(receiver.believed) == 2)
        told = {message["data"]["id"]: message for message in receiver.believed}
        assert [told[job_id]["type"] for job_id in jobs] == ["watermark.succeeded", "watermark.failed"]
        assert told[jobs[1]]["data"]["error"]["code"] == "no_placement"
        wait_until(lambda: service.states(endpoint) == {"delivered"})
        family = psutil.Process(process.pid).children(recursive=True)
        assert len(family) == 4  # the worker and its template, the gate's, and the sender
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
        assert all(map(gone, family))


def test_the_sender_ends_with_a_service_that_is_killed(tmp_path: Path) -> None:
    with Hooked(tmp_path).running([sys.executable, "-c", EVERYTHING]) as [process]:
        family = psutil.Process(process.pid).children()
        assert len(family) == 3  # the worker, the gate's template, and the sender
        process.kill()
        process.wait()
        wait_until(lambda: all(map(gone, family)))
