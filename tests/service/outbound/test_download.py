import gzip
import io
from socket import socket

import pytest

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.outbound.download import download
from tests.service.outbound.certificates import certified, trusting
from tests.service.outbound.servers import NAME, Script, client_of, read_request, replying, response, serving

LIMIT = 100_000


def fetched(script: Script, limit: int = LIMIT) -> bytes:
    target = io.BytesIO()
    with serving(script, certified(NAME)) as server:
        size = download(client_of(server, tls=trusting()), server.url("/asset.glb"), target, limit)
    assert size == len(target.getvalue())
    return target.getvalue()


def failure(script: Script, limit: int = LIMIT) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        fetched(script, limit)
    return caught.value


def test_a_file_arrives_whole() -> None:
    content = bytes(range(256)) * 300
    assert fetched(replying(response(content))) == content


def test_a_file_in_chunks_arrives_whole() -> None:
    chunked = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n" + b"5\r\nhello\r\n" * 1000 + b"0\r\n\r\n"
    assert fetched(replying(chunked)) == b"hello" * 1000


def test_a_file_of_just_the_limit_is_accepted_and_one_byte_more_is_not() -> None:
    assert len(fetched(replying(response(b"a" * LIMIT)))) == LIMIT
    assert failure(replying(response(b"a" * (LIMIT + 1)))).code == ServiceErrorCode.DOWNLOAD_TOO_LARGE


def test_a_declared_length_over_the_limit_is_refused_before_the_file_is_read() -> None:
    def announce(connection: socket) -> None:
        read_request(connection)
        connection.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 99999999999\r\n\r\n")
        connection.recv(1)  # ends when the client leaves; not a byte of the file is sent

    error = failure(announce)
    assert error.code == ServiceErrorCode.DOWNLOAD_TOO_LARGE
    assert "100,000" in error.message


def test_an_endless_file_is_left_at_the_limit() -> None:
    sent = 0

    def pour(connection: socket) -> None:
        nonlocal sent
        read_request(connection)
        connection.sendall(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n")
        while True:
            connection.sendall(b"1000\r\n" + bytes(4096) + b"\r\n")
            sent += 4096

    assert failure(pour).code == ServiceErrorCode.DOWNLOAD_TOO_LARGE
    assert sent < 2**25  # what fits into the buffers of the system, not what an engine could pour in a minute


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (response(status="302 Found", Location="https://127.0.0.1/"), "redirects"),
        (response(b"no", status="404 Not Found"), "404"),
        (response(status="204 No Content"), "204"),
        (response(b"part", status="206 Partial Content"), "206"),
        (response(gzip.compress(bytes(10**6)), Content_Encoding="gzip"), "encoded"),
        (response(Content_Encoding="br", content_encoding="identity"), "encoded"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 10\r\n\r\nshort", "broke off"),
        (b"HTTP/1.1 200 OK\r\n\r\nhello", "how long"),
        (b"HTTP/1.0 200 OK\r\nContent-Type: model/gltf-binary\r\n\r\nhello", "how long"),
    ],
    ids=["redirect", "404", "204", "206", "gzip", "hidden encoding", "cut off", "no length", "HTTP/1.0"],
)
def test_what_is_not_a_whole_file_is_not_accepted(answer: bytes, reason: str) -> None:
    error = failure(replying(answer))
    assert error.code == ServiceErrorCode.DOWNLOAD_FAILED
    assert reason in error.message
    assert error.remedy


def test_a_server_that_says_too_little_gives_no_more_than_it_said() -> None:
    assert fetched(replying(b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\nhello and more")) == b"hello"


def test_an_address_that_is_not_served_is_refused_as_such() -> None:
    with serving(replying(response())) as server, pytest.raises(MeshmarkError) as caught:
        download(client_of(server), "https://user:word@files.example/", io.BytesIO(), LIMIT)
    assert caught.value.code == ServiceErrorCode.ADDRESS_REFUSED
