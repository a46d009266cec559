"""Clients that prefer to wait (RFC 7240), over a real server, while the ledger moves their job on."""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing

import httpx2
import pytest

from core.errors import ErrorCode, MeshmarkError
from service import event_stream, waiting
from service.jobs.models import Queue
from service.jobs.queue import depth
from service.waiting import LONGEST, preferred_wait
from tests.service.edge import Edge, edge_with
from tests.worker.engines import asset
from tests.worker.waiting import wait_until

LONG = {"Prefer": "wait=50"}


@pytest.fixture(scope="module")
def edge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Edge]:
    with edge_with(data_dir=tmp_path_factory.mktemp("waiting"), max_uploads_at_once=1) as edge:
        yield edge


class Sender:
    """One request on its way, in a thread of its own."""

    def __init__(self, edge: Edge, headers: dict[str, str], kind: str = "watermarks") -> None:
        self.ledger, self.streams = edge.state.ledger, edge.state.streams
        self.http, self.kind = edge.client(), kind
        known = self._ids()
        fields = {"params": json.dumps({"text": "HI"} if kind == "watermarks" else {"texts": ["HI"]})}
        self._threads = ThreadPoolExecutor(1)
        self.answer: Future[httpx2.Response] = self._threads.submit(
            self.http.post, f"/v1/{kind}", files={"file": ("asset.obj", asset())}, data=fields, headers=headers
        )
        wait_until(lambda: self._ids() - known)
        [self.id] = self._ids() - known

    def _ids(self) -> set[str]:
        return {job["id"] for job in self.http.get(f"/v1/{self.kind}", params={"limit": 100}).json()["items"]}

    def is_waited_for(self) -> bool:
        return self.streams.count("alice") == 1

    def close(self) -> None:
        self._threads.shutdown()
        self.http.close()


Send = Callable[..., Sender]


@pytest.fixture
def send(edge: Edge) -> Iterator[Send]:
    with ExitStack() as stack:

        def sent(headers: dict[str, str], kind: str = "watermarks") -> Sender:
            return stack.enter_context(closing(Sender(edge, headers, kind)))

        yield sent


def succeed(sender: Sender) -> None:
    job = sender.ledger.claim(sender.id, 60)
    assert job is not None
    assert sender.ledger.succeed(job.lease)


@pytest.mark.parametrize("kind", ["watermarks", "verifications"])
def test_who_waits_is_answered_with_the_job_once_it_has_ended(send: Send, kind: str) -> None:
    sender = send(LONG, kind)
    wait_until(sender.is_waited_for)
    assert not sender.answer.done()
    succeed(sender)
    answer = sender.answer.result()
    assert answer.status_code == 200
    assert answer.headers["Preference-Applied"] == "wait"
    assert answer.json()["state"] == "succeeded"
    assert answer.json() == sender.http.get(answer.headers["Location"]).json()


def test_a_job_that_fails_is_an_answer_too(send: Send) -> None:
    sender = send(LONG)
    job = sender.ledger.claim(sender.id, 60)
    assert job is not None
    sender.ledger.fail(job.lease, MeshmarkError(ErrorCode.NO_PLACEMENT, "No place.", "Ask for less."))
    answer = sender.answer.result()
    assert (answer.status_code, answer.json()["error"]["code"]) == (200, "no_placement")


def test_a_job_that_takes_longer_is_answered_as_ever(send: Send) -> None:
    answer = send({"Prefer": "wait=1"}).answer.result()
    assert (answer.status_code, answer.json()["state"]) == (202, "queued")
    assert answer.headers["Preference-Applied"] == "wait"


@pytest.mark.parametrize("headers", [{}, {"Prefer": "wait=0"}, {"Prefer": "return=minimal"}])
def test_who_does_not_ask_to_wait_does_not_wait(send: Send, headers: dict[str, str]) -> None:
    answer = send(headers).answer.result()
    assert (answer.status_code, answer.json()["state"]) == (202, "queued")
    assert "Preference-Applied" not in answer.headers


def test_who_waits_keeps_nobody_from_sending_and_its_job_is_announced_meanwhile(edge: Edge, send: Send) -> None:
    before = depth(edge.state.queue, Queue.SMALL)
    sender = send(LONG)
    wait_until(lambda: depth(edge.state.queue, Queue.SMALL) == before + 1)
    assert send({}).answer.result().status_code == 202, "there is a place for one upload at a time only"
    assert not sender.answer.done()
    succeed(sender)
    assert sender.answer.result().status_code == 200


def test_a_client_that_leaves_waits_no_longer(edge: Edge, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(waiting, "LONGEST", 10**6)
    body = b'--b\r\nContent-Disposition: form-data; name="params"\r\n\r\n{"text": "HI"}\r\n'
    body += b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.obj"\r\n\r\n' + asset() + b"\r\n--b--\r\n"
    form = ["Content-Type: multipart/form-data; boundary=b", f"Content-Length: {len(body)}", "Prefer: wait=1000000"]
    line = edge.line(edge.head("POST /v1/watermarks", *form) + body)
    wait_until(lambda: edge.state.streams.count("alice") == 1)
    line.socket.close()
    wait_until(lambda: edge.state.streams.count("alice") == 0)


def test_where_too_many_wait_the_answer_comes_at_once(edge: Edge, send: Send, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_stream, "STREAMS_PER_TENANT", 0)
    before = depth(edge.state.queue, Queue.SMALL)
    answer = send(LONG).answer.result()
    assert answer.status_code == 202
    assert "Preference-Applied" not in answer.headers
    wait_until(lambda: depth(edge.state.queue, Queue.SMALL) == before + 1)


@pytest.mark.parametrize(
    ("prefer", "seconds"),
    [
        (None, 0),
        ("", 0),
        ("wait=10", 10),
        ("Wait = 10", 10),
        ('respond-async, wait="7"; x=1', 7),
        ("wait=5, wait=9", 5),
        ("wait=100000000000000000000", LONGEST),
        ("wait=-1", 0),
        ("wait=1.5", 0),
        ("wait=٣", 0),
        ("wait", 0),
        ("await=3", 0),
    ],
)
def test_seconds_are_read_as_the_rfc_writes_them(prefer: str | None, seconds: int) -> None:
    assert preferred_wait(prefer) == seconds
