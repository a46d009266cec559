from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import MeshmarkError
from service.config import Settings
from service.delivery import disposition, is_not_modified, requested_range
from service.jobs.models import ArtifactKind
from tests.service.conftest import Client, client_with
from tests.service.s3 import S3, Flaky, bucket_settings
from tests.worker.engines import asset

MODEL = b"glTF of HI"


@pytest.fixture(params=["folder", "s3"])
def client(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Client]:
    settings = Settings(data_dir=tmp_path)
    if request.param == "s3":
        settings = bucket_settings(request.getfixturevalue("s3").new_bucket(), tmp_path)
    with client_with(settings) as client:
        yield client


@pytest.fixture
def url(client: Client) -> str:
    """A model's address."""
    job = client.submit()
    client.run(job)
    return f"{job}/model"


def sha256(client: Client, url: str) -> str:
    job = client.worker.ledger.get(url.split("/")[3])
    assert job is not None
    artifact = job.artifact(ArtifactKind.MODEL)
    assert artifact is not None
    return artifact.sha256


def test_the_whole_comes_with_its_length_type_name_and_tag(client: Client, url: str) -> None:
    answer = client.http.get(url)
    assert (answer.status_code, answer.content) == (200, MODEL)
    headers = dict(answer.headers)
    assert headers["content-length"] == "10"
    assert headers["content-type"] == "model/gltf-binary"
    assert headers["content-disposition"] == 'attachment; filename="asset.watermarked.glb"'
    assert headers["etag"] == f'"{sha256(client, url)}"'
    assert headers["accept-ranges"] == "bytes"


def test_head_says_what_get_would_say_and_sends_nothing(client: Client, url: str) -> None:
    one = {"X-Request-ID": "one"}  # else each answer has an id of its own
    head, get = client.http.head(url, headers=one), client.http.get(url, headers=one)
    assert (head.status_code, head.content) == (200, b"")
    assert dict(head.headers) == dict(get.headers)
    assert client.http.head(url, headers={"Range": "bytes=0-3"}).status_code == 200  # RFC 9110: only GET has ranges


@pytest.mark.parametrize(
    ("wanted", "content", "named"),
    [
        ("bytes=0-3", b"glTF", "bytes 0-3/10"),
        ("bytes=8-", b"HI", "bytes 8-9/10"),
        ("bytes=-2", b"HI", "bytes 8-9/10"),
        ("bytes=-99", MODEL, "bytes 0-9/10"),
        ("bytes=8-99999999", b"HI", "bytes 8-9/10"),
        ("Bytes=0-0", b"g", "bytes 0-0/10"),
    ],
)
def test_a_part_is_sent_where_one_is_asked_for(
    client: Client, url: str, wanted: str, content: bytes, named: str
) -> None:
    answer = client.http.get(url, headers={"Range": wanted})
    assert (answer.status_code, answer.content, answer.headers["Content-Range"]) == (206, content, named)
    assert answer.headers["Content-Length"] == str(len(content))


@pytest.mark.parametrize("wanted", ["bytes=", "bytes=-", "bytes=5-2", "lines=0-3", "bytes=0-1,4-5", "bytes=a-b", "x"])
def test_a_range_that_is_none_or_several_is_ignored(client: Client, url: str, wanted: str) -> None:
    answer = client.http.get(url, headers={"Range": wanted})
    assert (answer.status_code, answer.content) == (200, MODEL)


@pytest.mark.parametrize("wanted", ["bytes=10-", "bytes=10-20", "bytes=-0"])
def test_a_range_after_the_end_is_a_problem_that_tells_the_size(client: Client, url: str, wanted: str) -> None:
    answer = client.http.get(url, headers={"Range": wanted})
    assert (answer.status_code, answer.json()["code"]) == (416, "range_not_satisfiable")
    assert answer.headers["Content-Range"] == "bytes */10"


def test_a_client_that_has_it_is_not_sent_it_again(client: Client, url: str) -> None:
    tag = client.http.get(url).headers["ETag"]
    for held in (tag, f"W/{tag}", f'"other", {tag}', "*"):
        for method in ("GET", "HEAD"):
            again = client.http.request(method, url, headers={"If-None-Match": held, "Range": "bytes=99-"})
            assert (again.status_code, again.content, again.headers["ETag"]) == (304, b"", tag)
    for other in ('"other"', tag.strip('"'), '""', "nonsense"):
        assert client.http.get(url, headers={"If-None-Match": other}).status_code == 200


def test_a_part_is_sent_only_of_what_the_client_has_begun(client: Client, url: str) -> None:
    tag = client.http.get(url).headers["ETag"]
    part = {"Range": "bytes=8-"}
    assert client.http.get(url, headers={**part, "If-Range": tag}).content == b"HI"
    for other in ('"other"', f"W/{tag}", "Wed, 21 Oct 2026 07:28:00 GMT"):
        assert client.http.get(url, headers={**part, "If-Range": other}).content == MODEL


def test_content_that_is_gone_is_not_delivered(client: Client, url: str) -> None:
    client.artifacts.remove(sha256(client, url))
    assert client.http.get(url).status_code == client.http.head(url).status_code == 404


@pytest.fixture
def flaky(s3: S3) -> Iterator[Flaky]:
    with Flaky(s3.url).running() as flaky:
        yield flaky


def outage(flaky: Flaky, s3: S3, tmp_path: Path, **settings: Any) -> Any:
    bucket = s3.new_bucket()
    bucket.endpoint = flaky.url
    return client_with(bucket_settings(bucket, tmp_path, **settings))


def test_while_the_store_fails_uploads_and_downloads_are_told_to_come_again(
    flaky: Flaky, s3: S3, tmp_path: Path
) -> None:
    with outage(flaky, s3, tmp_path) as client:
        url = client.submit()
        client.run(url)
        flaky.failing.set()
        upload = {"files": {"file": ("b.obj", asset("refuse"))}, "data": {"params": '{"text": "HI"}'}}
        answers = [client.http.post("/v1/watermarks", **upload), client.http.get(f"{url}/model")]
        for answer in answers:
            assert (answer.status_code, answer.json()["code"]) == (503, "service_unavailable")
            assert int(answer.headers["Retry-After"]) > 0
        assert client.http.head(f"{url}/model").status_code == 503
        assert client.worker.ledger.waiting(0) == []
        assert list(tmp_path.rglob(".staged-*")) == []
        flaky.failing.clear()
        assert client.http.get(f"{url}/model").content == MODEL
        assert client.http.post("/v1/watermarks", **upload).status_code == 202


def test_presigned_links_lead_to_the_content(s3: S3, tmp_path: Path) -> None:
    with client_with(bucket_settings(s3.new_bucket(), tmp_path, s3_presign=True)) as client:
        url = client.submit()
        client.run(url)
        answer = client.http.get(f"{url}/model")
        assert (answer.status_code, answer.headers["Cache-Control"]) == (307, "private, no-store")
        link = answer.headers["Location"]
        assert "X-Amz-Signature=" in link
        assert "secret-of-the-tests" not in link
        assert httpx2.get(link).content == MODEL
        assert httpx2.get(link, headers={"Range": "bytes=0-3"}).content == b"glTF"
        head = client.http.head(f"{url}/model")
        assert (head.status_code, head.headers["Content-Length"]) == (200, "10")
        assert client.http.get(f"{url}/model", headers={"If-None-Match": head.headers["ETag"]}).status_code == 304


@given(header=st.text(max_size=30) | st.from_regex(r"bytes=\d{0,22}-\d{0,22}"), size=st.integers(0, 2**40))
def test_whatever_range_is_asked_for_the_answer_lies_within_the_content(header: str, size: int) -> None:
    try:
        part = requested_range(header, size)
    except MeshmarkError:
        return
    if part:
        start, stop = part
        assert 0 <= start < stop <= size


@given(header=st.text(max_size=60))
def test_no_header_is_taken_for_a_tag_it_does_not_name(header: str) -> None:
    assert is_not_modified(header, '"abab"') == ('"abab"' in header or header.strip() == "*")


@given(name=st.text(max_size=60))
def test_a_file_name_cannot_break_out_of_its_header(name: str) -> None:
    header = disposition("".join(character for character in name if character.isprintable()))
    assert header.isascii()
    assert header.isprintable()
    assert header.count('"') == 2
    assert header.startswith('attachment; filename="')


def test_what_the_client_means_is_sent_and_nothing_else(client: Client, url: str) -> None:
    tag = f'"{sha256(client, url)}"'
    for meant in (tag, f'"other", {tag}', "*"):
        assert client.http.get(url, headers={"If-Match": meant}).content == MODEL
    for meant in ('"other"', f"W/{tag}", ""):
        for method in ("GET", "HEAD"):
            answer = client.http.request(method, url, headers={"If-Match": meant, "If-None-Match": tag})
            assert answer.status_code == 412
        assert client.http.get(url, headers={"If-Match": meant}).json()["code"] == "precondition_failed"
