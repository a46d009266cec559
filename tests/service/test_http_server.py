"""Hostile connections to the server, over sockets: the attacks in small."""

import json
import resource
import shlex
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.http_server import MOST_HEADERS
from tests.service.edge import Edge, Line, edge_with
from tests.service.harness import Service
from tests.worker.waiting import wait_until

HALF = b"GET /healthz HTTP/1.1\r\nHost: a\r\nX-a: "
WHOLE = b"GET /healthz HTTP/1.1\r\nHost: a\r\n\r\n"
LAST = b"GET /healthz HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n"


@pytest.fixture(scope="module")
def edge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Edge]:
    with edge_with(data_dir=tmp_path_factory.mktemp("edge"), client_timeout=60) as edge:
        yield edge


def refused(received: bytes, status: int = 400, code: str = "invalid_request") -> None:
    """One answer came, and it is this problem."""
    head, _, body = received.partition(b"\r\n\r\n")
    assert head.startswith(f"HTTP/1.1 {status} ".encode()), received
    assert b"\r\ncontent-type: application/problem+json" in head
    assert b"\r\nconnection: close" in head.lower()
    problem = json.loads(body)  # and nothing behind it
    assert (problem["status"], problem["code"]) == (status, code)
    assert problem["remedy"]


def test_a_connection_over_which_nothing_comes_is_closed(hasty: Edge) -> None:
    assert hasty.line().until_closed() == b""
    assert hasty.line(b"\r\n").until_closed() == b""


@pytest.mark.parametrize("begin", [HALF, b"G", b"POST /v1/uploads HTTP/1.1\r\n"])
def test_headers_that_do_not_end_are_not_waited_for(hasty: Edge, begin: bytes) -> None:
    refused(hasty.line(begin).until_closed(), 408, "request_timeout")


def test_headers_that_come_byte_by_byte_have_no_more_time(hasty: Edge) -> None:
    line, done = hasty.line(HALF), threading.Event()

    def dribble() -> None:
        while not done.wait(0.02) and line.send(b"x"):
            pass

    thread = threading.Thread(target=dribble)
    thread.start()
    received = line.until_closed()
    done.set()
    thread.join()
    assert received[:12] in (b"HTTP/1.1 408", b"")  # what was sent behind the end may reset the line


def test_the_headers_of_a_second_request_are_not_waited_for_either(hasty: Edge) -> None:
    received = hasty.line(WHOLE + HALF).until_closed()
    first, _, rest = received.partition(b'{"status":"ok"}')
    assert first.startswith(b"HTTP/1.1 200 ")
    assert rest == b"" or rest.startswith(b"HTTP/1.1 408 ")


def test_a_body_that_nobody_reads_does_not_hold_the_line(hasty: Edge) -> None:
    line, done = hasty.line(b"POST /nothing HTTP/1.1\r\nHost: a\r\nContent-Length: 60000\r\n\r\n"), threading.Event()
    thread = threading.Thread(target=lambda: any(done.wait(0.02) or not line.send(b"x") for _ in range(60_000)))
    thread.start()
    assert line.until_closed().startswith(b"HTTP/1.1 404 ")
    done.set()
    thread.join()


def test_an_answer_that_nobody_takes_does_not_hold_the_line(hasty: Edge) -> None:
    asking = b"GET /openapi.json HTTP/1.1\r\nHost: a\r\n\r\n" * 500
    hasty.line(asking, receive_buffer=4096)
    wait_until(lambda: len(hasty.server.server_state.connections) > 0)
    wait_until(lambda: len(hasty.server.server_state.connections) == 0)
    assert hasty.answers()


def test_connections_that_wait_for_nothing_keep_nobody_out(tmp_path: Path) -> None:
    with edge_with(data_dir=tmp_path, client_timeout=600, max_connections=10) as edge:
        lines = [edge.line(HALF if number % 2 else b"") for number in range(30)]
        assert edge.answers()
        wait_until(lambda: sum(line.is_closed() for line in lines) >= 20)
        assert [line.is_closed() for line in lines] == sorted((line.is_closed() for line in lines), reverse=True)
        assert edge.answers()


def test_where_every_connection_has_a_request_the_next_one_waits_for_a_place(tmp_path: Path) -> None:
    with edge_with(data_dir=tmp_path, client_timeout=600, max_connections=3) as edge:
        beginning = edge.head(
            "POST /v1/uploads", "Content-Type: application/json", "Content-Length: 10", "Connection: close"
        )
        lines = [edge.line(beginning) for _ in range(3)]
        wait_until(lambda: len(edge.server.server_state.tasks) == 3)
        waiting = edge.line(LAST)
        lines[0].send(b'{"size":1}')
        assert lines[0].until_closed().startswith(b"HTTP/1.1 201 ")
        assert waiting.until_closed().startswith(b"HTTP/1.1 200 ")
        assert not lines[1].is_closed()


def test_with_few_descriptors_the_service_answers_and_its_log_stays_short(tmp_path: Path) -> None:
    written = tmp_path / "log"
    program = f"ulimit -n 256; exec {shlex.quote(sys.executable)} -m service api 2>{shlex.quote(str(written))}"
    service = Service(tmp_path)
    with service.running(["sh", "-c", program]) as [process]:
        port = int(service.url.rsplit(":", 1)[1])
        lines = [Line(port, HALF) for _ in range(270)]
        assert service.is_up()
        for line in lines:
            line.socket.close()
        # Even where not one descriptor is left: what connects then is answered once there are some again.
        wait_until(service.is_up)
        service.client.close()
        limits = resource.prlimit(process.pid, resource.RLIMIT_NOFILE)
        wait_until(lambda: len(list(Path(f"/proc/{process.pid}/fd").iterdir())) < 50)
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (8, limits[1]))
        late = Line(port, LAST)
        wait_until(lambda: "could not be accepted" in written.read_text())
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, limits)
        assert late.until_closed().startswith(b"HTTP/1.1 200 ")
        assert len(written.read_text().splitlines()) < 100
        late.socket.close()


SMUGGLED = b"GET /smuggled HTTP/1.1\r\nHost: a\r\n\r\n"


def posted(*headers: bytes, version: bytes = b"1.1", host: bytes = b"Host: a\r\n", body: bytes = b"") -> bytes:
    lines = b"".join(header + b"\r\n" for header in headers)
    return b"POST /v1/uploads HTTP/" + version + b"\r\n" + host + lines + b"\r\n" + body


CHUNKED = b"Transfer-Encoding: chunked"
IN_DOUBT = {
    "TE and CL": posted(CHUNKED, b"Content-Length: 5", body=b"0\r\n\r\n"),
    "CL and TE": posted(b"Content-Length: 5", CHUNKED, body=b"0\r\n\r\n"),
    "two lengths": posted(b"Content-Length: 0", b"Content-Length: 5"),
    "one length twice": posted(b"Content-Length: 0", b"Content-Length: 0"),
    "a list of lengths": posted(b"Content-Length: 0, 0"),
    "negative length": posted(b"Content-Length: -1"),
    "signed length": posted(b"Content-Length: +1", body=b"x"),
    "hexadecimal length": posted(b"Content-Length: 0x1", body=b"x"),
    "length of 5,000 digits": posted(b"Content-Length: " + b"1" * 5000),
    "unknown coding": posted(b"Transfer-Encoding: cow", body=b"0\r\n\r\n"),
    "identity": posted(b"Transfer-Encoding: identity"),
    "another coding below": posted(b"Transfer-Encoding: gzip, chunked", body=b"0\r\n\r\n"),
    "chunked twice": posted(b"Transfer-Encoding: chunked, chunked", body=b"0\r\n\r\n"),
    "chunked, then not": posted(CHUNKED, b"Transfer-Encoding: identity", body=b"0\r\n\r\n"),
    "chunked in HTTP/1.0": posted(CHUNKED, version=b"1.0", body=b"0\r\n\r\n"),
    "quoted coding": posted(b'Transfer-Encoding: "chunked"', body=b"0\r\n\r\n"),
    "vertical tab before the coding": posted(b"Transfer-Encoding: \x0bchunked", body=b"0\r\n\r\n"),
    "space before the colon": posted(b"Content-Length : 0"),
    "tab before the colon": posted(b"Content-Length\t: 0"),
    "space before a name": posted(b"X-a: b", b" Content-Length: 0"),
    "folded header": posted(b"X-a: b", b"\tc"),
    "NUL in a header": posted(b"X-a: \x00"),
    "CR in a header": posted(b"X-a: b\rContent-Length: 5"),
    "line feed alone": b"GET /healthz HTTP/1.1\nHost: a\n\n",
    "header without a name": posted(b": x"),
    "header without a colon": posted(b"Content-Length 0"),
    "no host": posted(host=b""),
    "two hosts": posted(b"Host: b"),
    "chunk of negative length": posted(CHUNKED, body=b"-1\r\n"),
    "chunk length with 0x": posted(CHUNKED, body=b"0x1\r\nx\r\n0\r\n\r\n"),
    "chunk length with a space": posted(CHUNKED, body=b"1 \r\nx\r\n0\r\n\r\n"),
    "chunk length of 17 digits": posted(CHUNKED, body=b"1" + b"0" * 16 + b"\r\n"),
    "chunk longer than its length": posted(CHUNKED, body=b"1\r\nxy\r\n0\r\n\r\n"),
    "line feed alone after a chunk length": posted(CHUNKED, body=b"1\nx\r\n0\r\n\r\n"),
    "line feed alone in an extension": posted(CHUNKED, body=b"1;a\nx\r\n0\r\n\r\n"),
    "line feed alone after a chunk": posted(CHUNKED, body=b"1\r\nx\n0\r\n\r\n"),
    "CONNECT": b"CONNECT a:80 HTTP/1.1\r\nHost: a:80\r\n\r\n",
    "HTTP/2": b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    "HTTP/1.2": b"GET /healthz HTTP/1.2\r\nHost: a\r\n\r\n",
    "HTTP/0.9": b"GET /healthz\r\n\r\n",
    "TLS": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(200),
    "words": b"Dear sir or madam\r\n\r\n",
}


@pytest.mark.parametrize("name", IN_DOUBT)
def test_what_could_be_read_in_two_ways_or_is_no_http_is_a_problem_and_the_end(edge: Edge, name: str) -> None:
    line = edge.line(IN_DOUBT[name] + SMUGGLED)
    refused(line.until_closed())


@pytest.mark.parametrize("name", ["TE and CL", "two lengths", "unknown coding", "space before the colon"])
def test_a_request_that_came_before_is_answered(edge: Edge, name: str) -> None:
    received = edge.line(WHOLE + IN_DOUBT[name] + SMUGGLED).until_closed()
    assert received.startswith(b"HTTP/1.1 200 ")
    assert b"smuggled" not in received
    assert b" 404 " not in received


def test_requests_that_are_sent_at_once_are_answered_one_after_the_other(edge: Edge) -> None:
    received = edge.line(WHOLE + SMUGGLED + WHOLE * 50 + LAST).until_closed()
    starts = [piece[:3] for piece in received.split(b"HTTP/1.1 ")[1:]]
    assert starts == [b"200", b"404", *[b"200"] * 51]


def test_nothing_is_read_behind_the_last_request(edge: Edge) -> None:
    received = edge.line(LAST + SMUGGLED).until_closed()
    assert received.count(b"HTTP/1.1 ") == 1
    assert received.startswith(b"HTTP/1.1 200 ")


def test_what_stands_in_a_body_is_no_request(edge: Edge) -> None:
    length = f"Content-Length: {len(SMUGGLED)}"
    for head in (
        b"PUT /v1/uploads/x HTTP/1.1\r\nHost: a\r\n" + length.encode() + b"\r\n\r\n",  # without a key
        edge.head("PUT /v1/uploads/x", length, "Connection: close"),
        edge.head("POST /v1/nothing", length, "Connection: close"),
    ):
        received = edge.line(head + SMUGGLED).until_closed()
        assert received.count(b"HTTP/1.1 ") == 1
        assert received[9:12] in (b"401", b"404")


@pytest.mark.parametrize("apart", [False, True])
def test_a_wish_for_another_protocol_is_passed_over_with_its_body_intact(edge: Edge, apart: bool) -> None:
    body = b'{"size": 1}'
    upgrade = ("Upgrade: h2c", "Connection: Upgrade, HTTP2-Settings", "HTTP2-Settings: AAMAAABkAAQAoAAAAAIAAAAA")
    head = edge.head("POST /v1/uploads", *upgrade, "Content-Type: application/json", f"Content-Length: {len(body)}")
    if apart:  # so that each comes by itself
        line = edge.line(head)
        wait_until(lambda: edge.server.server_state.tasks)
        line.send(body + LAST)
    else:
        line = edge.line(head + body + head + body + LAST)
    received = line.until_closed()
    assert [piece[:3] for piece in received.split(b"HTTP/1.1 ")[1:]] == [b"201"] * (1 if apart else 2) + [b"200"]


def test_headers_have_a_size(edge: Edge) -> None:
    small = b"GET /healthz HTTP/1.1\r\nHost: a\r\nConnection: close\r\nX-a: " + b"x" * 40_000 + b"\r\n\r\n"
    assert edge.line(small).until_closed().startswith(b"HTTP/1.1 200 ")
    for large in (
        HALF + b"x" * 2 * MOST_HEADERS + b"\r\n\r\n",
        b"GET /healthz HTTP/1.1\r\nHost: a\r\n" + b"X-a: x\r\n" * MOST_HEADERS,
        b"GET /" + b"x" * 2 * MOST_HEADERS,
    ):
        line = edge.line()
        line.send(large)
        assert line.until_closed()[:12] in (b"HTTP/1.1 400", b"")  # what is not read any more may reset the line
    assert edge.answers()


@pytest.mark.parametrize(
    "flood",
    [
        b"1\r\nx\r\n" * 40_000,
        b"1;" + b"e" * 200_000 + b"\r\nx\r\n",
        b"0\r\n" + b"T: x\r\n" * 40_000,
    ],
)
def test_a_body_is_not_mostly_its_framing(edge: Edge, flood: bytes) -> None:
    with edge.client() as client:
        upload = client.post("/v1/uploads", json={"size": 100_000}).json()
    line = edge.line(edge.head(f"PUT {upload['url']}", CHUNKED.decode()))
    line.send(flood)
    assert line.until_closed()[:12] in (b"HTTP/1.1 400", b"")
    wait_until(lambda: edge.state.uploads.total() == 0)


def test_chunks_of_a_line_each_are_a_body(edge: Edge) -> None:
    rows = [b"v 0.123456 0.123456 0.123456\n"] * 20_000
    with edge.client() as client:
        upload = client.post("/v1/uploads", json={"size": sum(map(len, rows))}).json()
        assert client.put(upload["url"], content=iter(rows)).status_code == 204


def test_what_stands_behind_a_body_is_no_header(edge: Edge) -> None:
    key = f"Authorization: Bearer {edge.keys[0]}\r\n".encode()
    line = edge.line(posted(CHUNKED, b"Connection: close", body=b"0\r\n" + key + b"\r\n"))
    assert line.until_closed().startswith(b"HTTP/1.1 401 ")


def test_others_are_answered_while_somebody_sends_small_chunks(edge: Edge) -> None:
    with edge.client() as client, edge.client(1) as other:
        upload = client.post("/v1/uploads", json={"size": 3_000_000}).json()
        line = edge.line(edge.head(f"PUT {upload['url']}", CHUNKED.decode(), "Connection: close"))
        data = (b"c\r\n" + b"x" * 12 + b"\r\n") * 250_000 + b"0\r\n\r\n"
        thread = threading.Thread(target=line.send, args=(data,))
        thread.start()
        answered = 0
        while edge.state.uploads.total() or not answered:
            assert other.get("/v1/watermarks").status_code == 200
            answered += 1
        thread.join()
    assert line.until_closed().startswith(b"HTTP/1.1 204 ")
    assert answered >= 5
