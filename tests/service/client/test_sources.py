"""Assets that are sent ahead or at an address, batches and conversions, by both clients."""

import io
import json
import threading
from pathlib import Path
from typing import Any

import pytest

from service.client import AsyncClient, MeshmarkProblem, SourceUrl, UploadId
from tests.service.client.conftest import MODEL, Either, Hand
from tests.service.client.proxy import Fault, Proxy, answer
from tests.service.edge import Edge
from tests.worker.engines import asset

ADDRESS = "https://assets.example/models/spot.obj"


def test_an_upload_serves_many_orders(either: Either, hand: Hand, tmp_path: Path) -> None:
    path = tmp_path / "spot.obj"
    path.write_bytes(asset())
    upload = either(either.client.upload(path))
    assert isinstance(upload, UploadId)
    with hand.working():
        marked: Any = either(either.client.watermark(upload, "HI", color="none"))
        verified: Any = either(either.client.verify(upload, texts=["HI"]))
        outcomes = either.all(either.client.watermark_all([upload], "HO"))
    assert [marked.facts["input"]["filename"], verified.facts["parameters"]["texts"]] == ["spot.obj", ["HI"]]
    assert [(each.asset, each.job.state) for each in outcomes] == [(upload, "succeeded")]
    named = either(either.client.upload(asset(), "other.obj"))
    later = either(either.client.watermark(named, "HI", wait=False))
    assert later.facts["input"]["filename"] == "other.obj"


def test_an_upload_that_breaks_off_is_sent_again(either: Either, proxy: Proxy) -> None:
    proxy.faults = [Fault("PUT")]
    upload = either(either.client.upload(asset()))
    assert [line.split()[0] for line in proxy.lines()] == ["POST", "PUT", "PUT"]
    assert either(either.client.watermark(upload, "HI", wait=False)).state == "queued"


def name_of(hand: Hand, job_id: str) -> str:
    """The name of a job's asset, which the API tells once it is downloaded."""
    job = hand.ledger.get(job_id, "alice")
    assert job is not None
    return job.filename


def test_an_asset_at_an_address_is_named(either: Either, hand: Hand) -> None:
    job = either(either.client.watermark(SourceUrl(ADDRESS), "HI", wait=False))
    assert name_of(hand, job.id) == "spot.obj"
    with pytest.raises(MeshmarkProblem) as raised:
        either(either.client.verify(SourceUrl("https://127.0.0.1/"), texts=["HI"]))
    assert raised.value.code == "address_refused"


def test_a_batch_has_a_job_or_a_problem_for_each_item_and_may_be_sent_twice(
    either: Either, hand: Hand, proxy: Proxy
) -> None:
    upload = either(either.client.upload(asset()))
    items = [
        {"upload_id": upload.id, "parameters": {"text": "ONE"}, "metadata": {"order": "1"}},
        {"upload_id": "nothing", "parameters": {"text": "TWO"}},
        {"source_url": ADDRESS, "parameters": {"text": "SIX"}, "idempotency_key": upload.id},
    ]
    before = len(proxy.lines())
    proxy.faults = [Fault("POST")]
    first, refused, last = either(either.client.batch(items))
    assert proxy.lines()[before:] == ["POST /v1/watermarks/batch"] * 2
    assert (first.facts["parameters"]["text"], first.metadata) == ("ONE", {"order": "1"})
    assert (refused.code, refused.status) == ("not_found", 404)
    assert name_of(hand, last.id) == "spot.obj"
    listed = [each.id for each in either.all(either.client.jobs())]
    assert [listed.count(each.id) for each in (first, last)] == [1, 1]
    assert either(either.client.batch(items[2:]))[0].id == last.id


def test_an_asset_is_converted(either: Either, hand: Hand, tmp_path: Path) -> None:
    with hand.working():
        job = either(either.client.convert(asset(), filename="spot.obj"))
    assert either(job.download(tmp_path / "plain.glb")).read_bytes() == MODEL
    assert either(either.client.get(job.id, "conversions")).state == "succeeded"
    either(job.delete())
    assert either(job.refresh()).state == "expired"


class Watched(io.FileIO):
    """A file that notes the threads in which it is read and written."""

    threads: set[threading.Thread]

    def read(self, size: int | None = -1, /) -> bytes:
        self.threads.add(threading.current_thread())
        return super().read(-1 if size is None else size)

    def write(self, content: Any, /) -> int:
        self.threads.add(threading.current_thread())
        return super().write(content)


def test_the_loop_waits_for_no_disk(
    either: Either, hand: Hand, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "spot.obj"
    path.write_bytes(asset())
    usual = Path.open
    seen: dict[str, set[threading.Thread]] = {}

    def watched(self: Path, mode: str = "r", *more: Any) -> Any:
        if self.parent != tmp_path:
            return usual(self, mode, *more)
        file = Watched(self, mode)
        file.threads = seen.setdefault(mode, {threading.current_thread()})
        file.threads.add(threading.current_thread())
        return file

    monkeypatch.setattr(Path, "open", watched)
    upload = either(either.client.upload(path))
    with hand.working():
        job = either(either.client.watermark(path, "HI"))
    out = either(job.download(tmp_path / "out.glb"))
    monkeypatch.undo()
    assert (out.read_bytes(), bool(upload.id)) == (MODEL, True)
    assert seen.keys() == {"rb", "xb"}
    here = threading.current_thread()
    for threads in seen.values():
        assert here not in threads if isinstance(either.client, AsyncClient) else threads == {here}


def test_a_bucket_that_an_upload_goes_to_is_not_sent_the_key(either: Either, proxy: Proxy, edge: Edge) -> None:
    bucket = Proxy(edge.port)
    begun = {"id": "7", "url": f"http://localhost:{bucket.port}/object?signature=1"}
    proxy.faults = [Fault("POST /v1/uploads", answer=answer("201 Created", json.dumps(begun).encode()))]
    bucket.faults = [Fault("PUT", answer=answer("200 OK"))]
    assert either(either.client.upload(b"content")) == UploadId("7")
    (put,) = bucket.requests
    assert put.line == "PUT /object?signature=1"
    assert "authorization" in proxy.requests[0].headers
    assert "authorization" not in put.headers
    bucket.close()
