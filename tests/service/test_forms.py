"""Forms as clients write them, and as they should not."""

import json
from pathlib import Path
from typing import Any

import pytest
from httpx2 import Response

from tests.service.conftest import Client
from tests.worker.engines import asset

PARAMS = (b'name="params"', b'{"text": "HI"}')
FILE = (b'name="file"; filename="a.obj"', asset())
URL_ENCODED = "application/x-www-form-urlencoded"


def multipart(*parts: tuple[bytes, bytes], boundary: bytes = b"X", end: bytes = b"--X--\r\n") -> bytes:
    lines = (b"--" + boundary, b"\r\nContent-Disposition: form-data; ")
    return b"".join(b"".join([*lines, head, b"\r\n\r\n", data, b"\r\n"]) for head, data in parts) + end


def send(client: Client, body: Any, media_type: str = "multipart/form-data; boundary=X") -> Response:
    return client.http.post("/v1/watermarks", content=body, headers={"Content-Type": media_type})


def refused(answer: Response, says: str) -> None:
    problem = answer.json()
    assert (answer.status_code, problem["code"]) == (400, "invalid_request"), problem
    assert says in problem["detail"]
    assert problem["remedy"]


def test_fields_and_files_are_what_was_sent(client: Client) -> None:
    parts = (b'name="metadata"', '{"a": "é 漢"}'.encode()), PARAMS, (b'name="file"; filename="\xc3\xa4.obj"', asset())
    for media_type in ("multipart/form-data; boundary=X", 'multipart/form-data; charset=UTF-8; boundary="X"'):
        answer = send(client, multipart(*parts), media_type)
        assert answer.status_code == 202, answer.text
        assert answer.json()["input"]["filename"] == "ä.obj"
        assert answer.json()["metadata"] == {"a": "é 漢"}


@pytest.mark.parametrize("size", [1, 7, 1000, 65_536, 65_537])
def test_it_does_not_matter_in_which_pieces_a_form_comes(client: Client, size: int) -> None:
    content = asset() + b"\r\n--X\n\r\n--Y--\r\n-" * (4000 if size > 1 else 40)
    body = multipart(PARAMS, (FILE[0], content))
    answer = send(client, (body[start : start + size] for start in range(0, len(body), size)))
    assert answer.status_code == 202, answer.text
    job = client.worker.ledger.get(answer.json()["id"])
    assert job is not None
    stored = next(each for each in job.artifacts if each.size == len(content))
    assert b"".join(client.artifacts.read(stored.sha256, 0, stored.size)) == content


def test_a_large_file_leaves_nothing_but_what_is_kept(client: Client, tmp_path: Path) -> None:
    content = asset() + b"#" * 90_000
    assert send(client, multipart(PARAMS, (FILE[0], content))).status_code == 202
    assert send(client, multipart(PARAMS, (FILE[0], content), end=b"")).status_code == 400
    assert list(tmp_path.rglob(".staged-*")) == []


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        (((b'name="params"', b'{"text": "\xff"}'), FILE), "'params' is not UTF-8"),
        (((b'name="metadata"', b'{"a": "\xe4"}'), PARAMS, FILE), "'metadata' is not UTF-8"),
        ((PARAMS, (b'name="file"; filename="\xff.obj"', asset())), "the name of a file is not UTF-8"),
        ((PARAMS, FILE, (b'name="\xff"', b"")), "the name of a part is not UTF-8"),
    ],
)
def test_text_that_is_not_utf_8_is_refused(client: Client, parts: Any, says: str) -> None:
    answer = send(client, multipart(*parts))
    refused(answer, says)
    assert "UTF-8" in answer.json()["remedy"]


@pytest.mark.parametrize("body", [b"params=%FF&upload_id=x", b"params=\xff&upload_id=x", b"par%E4ms=1"])
def test_text_that_is_not_utf_8_is_refused_in_the_other_kind_of_form_too(client: Client, body: bytes) -> None:
    refused(send(client, body, URL_ENCODED), "not UTF-8")


def test_another_character_set_is_refused_and_not_guessed(client: Client) -> None:
    for charset in ("latin-1", "punycode", "utf-16"):
        refused(send(client, multipart(PARAMS, FILE), f"multipart/form-data; boundary=X; charset={charset}"), charset)


def test_fields_alone_may_come_url_encoded(client: Client) -> None:
    upload = client.http.post("/v1/uploads", json={"size": len(asset())}).json()
    assert client.http.put(upload["url"], content=asset()).status_code == 204
    body = f"params=%7B%22text%22:+%22%C3%A4%22%7D&upload_id={upload['id']}&metadata=" + json.dumps({"a": "ä"})
    answer = send(client, body.encode(), URL_ENCODED)
    assert answer.status_code == 202, answer.text
    assert (answer.json()["parameters"]["text"], answer.json()["metadata"]) == ("ä", {"a": "ä"})


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (multipart(PARAMS, FILE, end=b""), "ends before its last boundary"),
        (b"", "ends before its last boundary"),
        (b"Dear sir", "not multipart/form-data"),
        (multipart(PARAMS, FILE, FILE, FILE, FILE), "too many files"),
        (multipart(FILE, *[PARAMS] * 8), "too many fields"),
        (multipart(FILE, (b'name="params"', b"x" * 70_000)), "65,536"),
        (multipart((b'filename="a.obj"', b"x")), "no name"),
        (multipart((b'name="a"\r\nX-a: ' + b"x" * 10_000, b"x")), "not multipart/form-data"),
        (multipart((b'name="a"' + b"\r\nX-a: x" * 100, b"x")), "not multipart/form-data"),
    ],
)
def test_a_form_that_is_none_is_told_why(client: Client, body: bytes, says: str) -> None:
    refused(send(client, body), says)


def test_a_form_needs_a_boundary(client: Client) -> None:
    refused(send(client, b"x", "multipart/form-data"), "boundary")
    refused(send(client, b"x", f"multipart/form-data; boundary={'x' * 300}"), "oundary")


@pytest.mark.parametrize("body", [b"a=b&" * 10, b"params=" + b"x" * 70_000, b"params=" + b"x" * 500_000])
def test_the_other_kind_of_form_has_the_same_bounds(client: Client, body: bytes) -> None:
    refused(send(client, body, URL_ENCODED), "65,536" if b"x" in body else "too many fields")
