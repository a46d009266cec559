"""Bodies that do not come as they should, tried over sockets: the attacks in small."""

import json
import os
import resource
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import httpx2
import pytest

from tests.service.edge import Edge, edge_with
from tests.service.harness import Service
from tests.worker.engines import asset
from tests.worker.waiting import wait_until

PART = b'--X\r\nContent-Disposition: form-data; name="file"; filename="a.obj"\r\n\r\n'
FORM = "Content-Type: multipart/form-data; boundary=X"
JSON = "Content-Type: application/json"
LONG = "Content-Length: 9000000"
MIB = 2**20
UNDER_WAY = ["POST /v1/watermarks", "PUT UPLOAD", "POST /v1/uploads", "POST /v1/watermarks/batch"]


@pytest.fixture(scope="module")
def demanding(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Edge]:
    """One to which a megabyte a second must come."""
    with edge_with(data_dir=tmp_path_factory.mktemp("demanding"), client_timeout=0.5, client_rate=MIB) as edge:
        yield edge


def beginning(edge: Edge, request: str, length: int = 9_000_000) -> bytes:
    """The headers of a request, and of a form the beginning of its file."""
    if "UPLOAD" in request:
        with edge.client() as client:
            request = f"PUT {client.post('/v1/uploads', json={'size': length}).json()['url']}"
    is_form = request == "POST /v1/watermarks"
    if not (is_form or request.startswith("PUT")):
        length = 60_000
    head = edge.head(request, FORM if is_form else JSON, f"Content-Length: {length}")
    return head + (PART if is_form else b"")


def problem(received: bytes) -> tuple[int, str, str]:
    """Status and code of an answer that is a problem, and its headers."""
    head, _, body = received.partition(b"\r\n\r\n")
    content = json.loads(body)
    assert head.startswith(f"HTTP/1.1 {content['status']} ".encode())
    assert content["remedy"]
    return content["status"], content["code"], head.decode().lower()


def files_of(pid: int) -> list[str]:
    """What a process has open."""
    names = []
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):
            names.append(os.fspath(link.readlink()))
    return names


@pytest.mark.parametrize("request_line", UNDER_WAY)
def test_a_body_that_stands_still_is_given_up(hasty: Edge, request_line: str) -> None:
    line = hasty.line(beginning(hasty, request_line) + b"x" * 1000)
    status, code, headers = problem(line.until_closed())
    assert (status, code) == (408, "request_timeout")
    assert "connection: close" in headers


@pytest.mark.parametrize("request_line", UNDER_WAY)
def test_a_body_that_comes_too_slowly_is_given_up(demanding: Edge, request_line: str) -> None:
    line = demanding.line(beginning(demanding, request_line))
    for _ in range(10_000):
        if line.is_readable() or not line.send(b"x"):
            break
        time.sleep(0.02)
    assert line.until_closed()[:12] in (b"HTTP/1.1 408", b"")  # what was sent behind the end may reset the line
    wait_until(lambda: demanding.state.uploads.total() == 0)


def test_a_stream_of_events_is_not_given_up(hasty: Edge) -> None:
    with hasty.client() as client:
        parts = {"file": ("asset.obj", asset())}
        location = client.post("/v1/watermarks", files=parts, data={"params": '{"text": "HI"}'}).headers["Location"]
        with client.stream("GET", f"{location}/events") as answer:
            lines = answer.iter_lines()
            assert "watermark.queued" in next(line for line in lines if line.startswith("event"))
            time.sleep(1.5)  # longer than a body may stand still
            assert client.delete(location).status_code == 204
            assert "watermark.canceled" in next(line for line in lines if line.startswith("event"))


@pytest.mark.parametrize(
    ("request_line", "key", "status"), [("POST /v1/uploads", True, 413), ("POST /v1/watermarks", False, 401)]
)
def test_who_sends_all_of_a_body_that_is_refused_reads_why(
    hasty: Edge, request_line: str, key: bool, status: int
) -> None:
    method, path = request_line.split()
    connection = HTTPConnection("127.0.0.1", hasty.port)  # it reads nothing before it has sent everything
    headers = {"Authorization": f"Bearer {hasty.keys[0]}"} if key else {}
    with closing(connection):
        connection.request(method, path, b"x" * 8 * MIB, headers)
        assert connection.getresponse().status == status


def test_so_many_uploads_of_a_tenant_are_taken_at_a_time(tmp_path: Path) -> None:
    with edge_with(data_dir=tmp_path, client_timeout=600, max_uploads_at_once=2) as edge:
        lines = [edge.line(beginning(edge, request)) for request in UNDER_WAY[:2]]
        wait_until(lambda: edge.state.uploads.total() == 2)
        order: dict[str, Any] = {"files": {"file": ("a.obj", asset())}, "data": {"params": '{"text": "HI"}'}}
        with edge.client() as client, edge.client(1) as other:
            url = client.post("/v1/uploads", json={"size": 1}).json()["url"]
            for refused in (client.post("/v1/watermarks", **order), client.put(url, content=b"x")):
                assert (refused.status_code, refused.json()["code"]) == (429, "too_many_uploads")
                assert int(refused.headers["Retry-After"]) < 60
            assert client.get("/v1/watermarks").status_code == 200
            assert other.post("/v1/watermarks", **order).status_code == 202
            lines[0].socket.close()
            wait_until(lambda: edge.state.uploads.total() == 1)
            assert client.post("/v1/watermarks", **order).status_code == 202


@pytest.mark.parametrize("request_line", UNDER_WAY[:2])
def test_what_has_come_of_an_asset_lies_beside_where_it_will_be_kept(tmp_path: Path, request_line: str) -> None:
    folder = os.fspath(tmp_path / "artifacts")
    with edge_with(data_dir=tmp_path, client_timeout=600) as edge:
        line = edge.line(beginning(edge, request_line) + b"x" * 3 * MIB)
        wait_until(lambda: any(name.startswith(folder) for name in files_of(os.getpid())))
        line.socket.close()
        wait_until(lambda: not any(name.startswith(folder) for name in files_of(os.getpid())))
    assert list(Path(folder).glob(".staged-*")) == []


def test_a_disk_that_takes_no_more_is_no_fault_of_the_client(tmp_path: Path) -> None:
    """A limit to the size of files stands in for the full disk: it is the same failure to write."""
    written = tmp_path / "log"
    program = f"exec {shlex.quote(sys.executable)} -m service api 2>{shlex.quote(os.fspath(written))}"
    service = Service(tmp_path)
    with service.running(["sh", "-c", program]) as [process]:

        def send(to: str) -> httpx2.Response:
            content = asset() + b"#" * 3 * MIB
            if to == "form":
                return service.submit(content)
            url = service.client.post("/v1/uploads", json={"size": len(content)}).json()["url"]
            return service.client.put(url, content=content)

        limits = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (2 * MIB, limits[1]))
        for to in ("form", "upload"):
            before = len(written.read_text())
            refused = send(to)
            assert (refused.status_code, refused.json()["code"]) == (503, "service_unavailable")
            assert int(refused.headers["Retry-After"]) > 0
            lines = map(json.loads, written.read_text()[before:].splitlines())
            assert [each["event"] for each in lines if each["level"] == "error"] == ["the disk cannot be written to"]
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, limits)
        for to in ("form", "upload"):
            assert send(to).is_success
    assert list((tmp_path / "data").rglob(".staged-*")) == []
