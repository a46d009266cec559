"""Webhooks are sent to a real server over TLS that verifies them with the reference library."""

import json
import socket
import threading
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from standardwebhooks.webhooks import Webhook, WebhookVerificationError

from core.errors import MeshmarkError
from service.jobs.models import EventType
from service.outbound.client import OutboundClient
from service.outbound.policy import Policy
from service.webhooks.deliver import TIMEOUTS, Outcome, Result, deliver
from service.webhooks.payload import Message
from service.webhooks.signing import new_secret
from tests.service.outbound.certificates import certified, trusting
from tests.service.outbound.servers import BRIEF, NAME, Script, at, client_of, read_request, replying, response, serving
from tests.worker.waiting import PATIENCE

SECRET = new_secret()
NOW = datetime(2026, 1, 31, 12, 0, tzinfo=UTC)  # receivers that verify want the true time, which the tests give them
MESSAGE = Message.of("msg_1", EventType.SUCCEEDED, NOW, {"id": "1", "state": "succeeded"})


class Receiver:
    """Answers 200 to what it can verify and 401 to the rest, and keeps what it believed."""

    def __init__(self, secret: str) -> None:
        self.believed: list[Any] = []
        self.heads: list[dict[str, str]] = []
        self._webhook = Webhook(secret)

    def __call__(self, connection: socket.socket) -> None:
        head, body = read_request(connection)
        lines = head.decode().split("\r\n")
        headers = dict(line.split(": ", 1) for line in lines[1:])
        self.heads.append({name.lower(): value for name, value in headers.items()})
        try:
            self.believed.append(self._webhook.verify(body, headers))
        except WebhookVerificationError:
            connection.sendall(response(b"who are you?", "401 Unauthorized"))
        else:
            connection.sendall(response(b"thank you"))


def sent(
    script: Script, secrets: tuple[str, ...] = (SECRET,), attempt: int = 1, draw: float = 0.0, now: datetime = NOW
) -> Outcome:
    with serving(script, certified(NAME)) as server:
        client = client_of(server, tls=trusting())
        return deliver(client, server.url("/hook"), secrets, MESSAGE, attempt, now, draw)


def wait(outcome: Outcome) -> float:
    """Seconds between the end of the attempt and the next one."""
    assert outcome.retry_at is not None
    return (outcome.retry_at - NOW).total_seconds() - outcome.seconds


def test_a_receiver_verifies_what_it_gets() -> None:
    receiver = Receiver(SECRET)
    outcome = sent(receiver, now=datetime.now(UTC))
    assert (outcome.result, outcome.status, outcome.error) == (Result.DELIVERED, 200, None)
    assert (outcome.snippet, outcome.retry_at) == ("thank you", None)
    assert outcome.seconds > 0
    assert receiver.believed == [json.loads(MESSAGE.body)]
    [head] = receiver.heads
    assert head["content-type"] == "application/json"
    assert head["user-agent"].startswith("Meshmark/")
    assert head["webhook-id"] == MESSAGE.id


def test_while_a_secret_is_rotated_receivers_with_the_old_and_the_new_one_verify() -> None:
    old, new = new_secret(), new_secret()
    for known in (old, new):
        assert sent(Receiver(known), secrets=(new, old), now=datetime.now(UTC)).result == Result.DELIVERED
    stranger = Receiver(new_secret())
    outcome = sent(stranger, secrets=(new, old), now=datetime.now(UTC))
    assert (outcome.result, outcome.status, outcome.snippet) == (Result.RETRY, 401, "who are you?")
    assert stranger.believed == []


def test_a_repetition_has_the_same_id_and_body_but_a_time_of_its_own() -> None:
    receiver = Receiver(SECRET)
    at = datetime.now(UTC)
    sent(receiver, now=at)
    sent(receiver, attempt=2, now=at + timedelta(seconds=5))
    assert receiver.believed[0] == receiver.believed[1]
    first, second = receiver.heads
    assert first["webhook-id"] == second["webhook-id"]
    assert int(second["webhook-timestamp"]) - int(first["webhook-timestamp"]) == 5


@pytest.mark.parametrize("status", ["200 OK", "202 Accepted", "204 No Content", "299 Fine"])
def test_any_status_of_success_is_a_delivery(status: str) -> None:
    assert sent(replying(response(status=status))).result == Result.DELIVERED


@pytest.mark.parametrize("status", [301, 307, 400, 401, 404, 429, 500, 502, 503, 504])
def test_any_other_status_is_tried_again(status: int) -> None:
    outcome = sent(replying(response(status=f"{status} No", Location="https://127.0.0.1/")))
    assert (outcome.result, outcome.status) == (Result.RETRY, status)
    assert wait(outcome) == pytest.approx(5)


def test_the_last_attempt_is_the_last() -> None:
    refusing = replying(response(status="500 No"))
    assert wait(sent(refusing, attempt=9)) == pytest.approx(86_400)
    outcome = sent(refusing, attempt=10)
    assert (outcome.result, outcome.retry_at) == (Result.EXHAUSTED, None)


def test_the_wait_is_lengthened_by_chance() -> None:
    assert wait(sent(replying(response(status="500 No")), attempt=2, draw=0.5)) == pytest.approx(330)


def test_an_endpoint_that_is_gone_is_sent_nothing_more() -> None:
    outcome = sent(replying(response(status="410 Gone")))
    assert (outcome.result, outcome.status, outcome.retry_at) == (Result.ENDPOINT_GONE, 410, None)


@pytest.mark.parametrize(
    ("status", "asked", "seconds"),
    [
        ("429 Too Many", "60", 60),
        ("503 Unavailable", "3600", 3600),
        ("503 Unavailable", "99999999", 86_400),
        ("429 Too Many", "soon", 5),
        ("500 No", "60", 5),
    ],
)
def test_a_receiver_under_load_is_given_the_time_it_asks_for(status: str, asked: str, seconds: int) -> None:
    assert wait(sent(replying(response(status=status, Retry_After=asked)))) == pytest.approx(seconds)


def test_of_an_endless_answer_the_first_kilobyte_is_kept() -> None:
    def pour(connection: socket.socket) -> None:
        read_request(connection)
        connection.sendall(b"HTTP/1.1 500 No\r\nTransfer-Encoding: chunked\r\n\r\n")
        while True:
            connection.sendall(b"1000\r\n" + b"a" * 4096 + b"\r\n")

    assert sent(pour).snippet == "a" * 1024


def test_an_answer_that_is_no_text_can_be_stored_all_the_same() -> None:
    outcome = sent(replying(response(b"a\x00b\x1b[31m\xff\xfe\nc")))
    assert outcome.snippet == "a\ufffdb\ufffd[31m\ufffd\ufffd\nc"


def test_an_answer_that_breaks_off_counts_by_its_status() -> None:
    outcome = sent(replying(b"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\nthank"))
    assert (outcome.result, outcome.status, outcome.snippet) == (Result.DELIVERED, 200, "thank")
    assert outcome.error


def test_a_receiver_that_does_not_answer_is_tried_again() -> None:
    gone = threading.Event()

    def silent(_connection: socket.socket) -> None:
        gone.wait(PATIENCE)

    with serving(silent, certified(NAME)) as server:
        outcome = deliver(
            client_of(server, tls=trusting(), timeouts=BRIEF), server.url(), [SECRET], MESSAGE, 1, NOW, 0.0
        )
        gone.set()
    assert (outcome.result, outcome.status) == (Result.RETRY, None)
    assert outcome.error
    assert "in time" in outcome.error


def test_an_endpoint_inside_the_network_is_not_called_and_tried_again_as_its_name_may_move() -> None:
    with serving(replying(response()), certified(NAME)) as server:
        client = OutboundClient(Policy(ports=frozenset({server.port})), TIMEOUTS, at("127.0.0.1"))
        outcome = deliver(client, server.url(), [SECRET], MESSAGE, 1, NOW, 0.0)
    assert server.connections == 0
    assert (outcome.result, outcome.status, outcome.snippet) == (Result.RETRY, None, "")
    assert outcome.error
    assert "no public address" in outcome.error


def test_a_secret_that_is_none_is_a_fault_of_ours_and_not_of_the_endpoint() -> None:
    with pytest.raises(MeshmarkError, match="invalid_secret"):
        sent(replying(response()), secrets=("none",))
