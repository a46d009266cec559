import socket
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from threading import Event

import pytest
import trustme

from core.errors import MeshmarkError
from service.outbound.client import OutboundClient
from service.outbound.errors import Unreachable
from service.outbound.policy import Policy, Timeouts
from tests.service.outbound.certificates import certified, trusting
from tests.service.outbound.servers import (
    BRIEF,
    NAME,
    Script,
    at,
    client_of,
    read_request,
    replying,
    response,
    serving,
)


def fetch(client: OutboundClient, url: str, content: bytes | None = None) -> tuple[int, bytes]:
    with client.send("POST" if content else "GET", url, content=content) as answer:
        return answer.status, b"".join(answer.body)


def wait_for_the_end(connection: socket.socket) -> None:
    while connection.recv(65536):
        pass


def dribbling(opening: bytes, drop: bytes) -> Script:
    def script(connection: socket.socket) -> None:
        read_request(connection)
        connection.sendall(opening)
        while True:  # until the client leaves
            connection.sendall(drop)
            time.sleep(0.1)

    return script


def test_a_host_is_asked_by_its_name_over_a_connection_to_its_address() -> None:
    requests: list[tuple[bytes, bytes]] = []
    with serving(replying(response(b"hello"), requests=requests), certified(NAME)) as server:
        assert fetch(client_of(server, tls=trusting()), server.url("/a?b=c")) == (200, b"hello")
    [(head, body)] = requests
    lines = head.decode().split("\r\n")
    assert lines[0] == "GET /a?b=c HTTP/1.1"
    assert f"Host: {NAME}:{server.port}" in lines
    assert "Accept-Encoding: identity" in lines
    assert body == b""
    assert server.names == [NAME]


def test_a_body_and_headers_are_sent() -> None:
    requests: list[tuple[bytes, bytes]] = []
    with serving(replying(response(), requests=requests)) as server:
        sent = {"X-Test": "1", "Host": "other.example"}
        with client_of(server).send("POST", server.url(), sent, b"payload") as answer:
            assert answer.status == 200
    [(head, body)] = requests
    assert b"X-Test: 1" in head
    assert f"Host: {NAME}".encode() in head
    assert b"other.example" not in head
    assert body == b"payload"


@pytest.mark.parametrize(
    ("context", "reason"),
    [
        (lambda: certified("other.example"), "Hostname mismatch"),
        (lambda: certified(NAME, issuer=trustme.CA()), "unable to get local issuer"),
        (lambda: certified(NAME, not_after=datetime(2020, 1, 1, tzinfo=UTC)), "expired"),
    ],
    ids=["another name", "another authority", "expired"],
)
def test_a_certificate_that_does_not_fit_ends_the_request(context: object, reason: str) -> None:
    assert callable(context)
    requests: list[tuple[bytes, bytes]] = []
    with (
        serving(replying(response(), requests=requests), context()) as server,
        pytest.raises(Unreachable, match=f"certificate is not valid.*{reason}"),
    ):
        fetch(client_of(server, tls=trusting()), server.url())
    assert requests == []


def test_an_address_is_checked_against_its_certificate_too() -> None:
    with serving(replying(response(b"hello")), certified("127.0.0.1")) as server:
        assert fetch(client_of(server, tls=trusting()), server.url(host="127.0.0.1")) == (200, b"hello")


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", NAME, "[::ffff:127.0.0.1]"])
def test_nothing_connects_to_this_machine_unless_it_is_allowed(host: str) -> None:
    with serving(replying(response())) as server:
        policy = Policy(schemes=frozenset({"http"}), ports=frozenset({server.port}))
        with pytest.raises((MeshmarkError, Unreachable), match=r"address_refused|no public address"):
            fetch(OutboundClient(policy, BRIEF, at("127.0.0.1")), server.url(host=host))
    assert server.connections == 0


def test_a_name_is_resolved_once_and_the_answer_pinned() -> None:
    answers: Iterator[list[str]] = iter([["127.0.0.1"], ["127.0.0.2"]])
    asked: list[str] = []

    def rebinding(host: str) -> list[str]:
        asked.append(host)
        return next(answers)

    with (
        serving(replying(response(b"outside"))) as outside,
        serving(replying(response(b"inside")), host="127.0.0.2", port=outside.port) as inside,
    ):
        client = client_of(outside, resolver=rebinding, allow="127.0.0.1/32")
        assert fetch(client, outside.url()) == (200, b"outside")
        assert asked == [NAME]
        with pytest.raises(Unreachable, match="no public address"):  # the second request meets the second answer
            fetch(client, outside.url())
    assert inside.connections == 0


def test_another_address_is_tried_when_the_first_takes_no_connection() -> None:
    with serving(replying(response(b"hello"))) as server:
        client = client_of(server, resolver=at("127.0.0.2", "127.0.0.1"))
        assert fetch(client, server.url()) == (200, b"hello")
        with pytest.raises(Unreachable, match="no connection"):
            fetch(client_of(server, resolver=at("127.0.0.2", "127.0.0.3")), server.url())


def test_a_redirect_is_an_answer_and_not_followed() -> None:
    with serving(replying(response())) as inside:
        redirect = response(status="302 Found", Location=inside.url())
        with serving(replying(redirect)) as server:
            assert fetch(client_of(server, inside), server.url())[0] == 302
    assert inside.connections == 0


def test_proxies_in_the_environment_are_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(replying(response(b"proxied"))) as proxy, serving(replying(response(b"direct"))) as server:
        for name in ("http_proxy", "https_proxy", "all_proxy"):
            monkeypatch.setenv(name, f"http://127.0.0.1:{proxy.port}")
            monkeypatch.setenv(name.upper(), f"http://127.0.0.1:{proxy.port}")
        monkeypatch.delenv("no_proxy", raising=False)
        assert fetch(client_of(server), server.url()) == (200, b"direct")
    assert proxy.connections == 0


def test_nothing_is_unpacked() -> None:
    packed = bytes.fromhex("1f8b0800")
    with serving(replying(response(packed, Content_Encoding="gzip"))) as server:
        assert fetch(client_of(server), server.url()) == (200, packed)


SLOW = Timeouts(connect=1.0, silence=0.6, total=1.0)


@pytest.mark.parametrize(
    "script",
    [
        wait_for_the_end,
        dribbling(b"", b"H"),
        dribbling(b"HTTP/1.1 200 OK\r\n", b"X-A: b\r\n"),
        dribbling(b"", b"HTTP/1.1 103 Early Hints\r\n\r\n"),
        dribbling(b"HTTP/1.1 200 OK\r\nContent-Length: 1000000\r\n\r\n", b"a"),
        dribbling(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n", b"1\r\na\r\n"),
    ],
    ids=["silence", "status line", "header lines", "informational answers", "body", "chunks"],
)
@pytest.mark.parametrize("encrypted", [False, True])
def test_a_server_that_dribbles_is_left_at_the_deadline(script: Script, encrypted: bool) -> None:
    with serving(script, certified(NAME) if encrypted else None) as server:
        client = client_of(server, tls=trusting(), timeouts=SLOW)
        with pytest.raises(Unreachable, match="in time"):
            fetch(client, server.url())


def test_a_handshake_that_does_not_go_on_is_left() -> None:
    with serving(wait_for_the_end) as server, pytest.raises(Unreachable, match="in time"):
        fetch(client_of(server, tls=trusting(), timeouts=BRIEF), server.url().replace("http:", "https:"))


@pytest.mark.parametrize("encrypted", [False, True])
def test_a_server_that_takes_the_request_in_sips_is_left_at_the_deadline(encrypted: bool) -> None:
    left = Event()

    def sip(connection: socket.socket) -> None:
        while connection.recv(2**18) and not left.wait(0.03):  # often enough that no single write waits for long
            pass

    with serving(sip, certified(NAME) if encrypted else None) as server:
        with pytest.raises(Unreachable, match="in time"):  # at that pace it would take seven seconds
            fetch(client_of(server, tls=trusting(), timeouts=SLOW), server.url(), bytes(2**26))
        left.set()


@pytest.mark.parametrize(
    "answer",
    [
        b"",
        b"SSH-2.0-OpenSSH_9.6\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 10\r\n\r\nshort",
        b"HTTP/1.1 200 OK\r\nContent-Length: -1\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\nhello",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\nhello\r\n",
        b"HTTP/1.1 200 OK\r\n" + b"X-Long: " + b"a" * 200_000,
        b"HTTP/1.1 200 OK\r\n" + b"X-Many: a\r\n" * 20_000,
    ],
    ids=["nothing", "no HTTP", "short", "negative", "two lengths", "cut off", "no chunk", "long line", "many lines"],
)
def test_an_answer_that_is_broken_is_said_to_be(answer: bytes) -> None:
    with serving(replying(answer)) as server, pytest.raises(Unreachable, match="broke off"):
        fetch(client_of(server), server.url())


def test_what_goes_wrong_while_an_answer_is_used_is_not_mistaken_for_the_servers_fault() -> None:
    with (
        serving(replying(response(b"hello"))) as server,
        pytest.raises(ZeroDivisionError),
        client_of(server).send("GET", server.url()),
    ):
        _ = 1 / 0


def test_header_fields_of_one_name_are_one_list() -> None:
    with (
        serving(replying(response(b"", Via="a", VIA="b"))) as server,
        client_of(server).send("GET", server.url()) as answer,
    ):
        assert answer.headers["via"] == "a, b"


def test_without_a_certificate_authority_of_ones_own_the_systems_count() -> None:
    with serving(replying(response()), certified(NAME)) as server, pytest.raises(Unreachable, match="certificate"):
        fetch(client_of(server), server.url())
