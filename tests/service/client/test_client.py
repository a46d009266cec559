"""Both clients against a real service, with connections that break and answers that refuse."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from service.client import Client, MeshmarkProblem, operations
from service.client.batches import all_of
from tests.service.client.conftest import MODEL, REPORT, Either, Hand, wait_for_events
from tests.service.client.proxy import Fault, Proxy, answer
from tests.service.edge import Edge
from tests.service.harness import free_port
from tests.worker.engines import asset
from tests.worker.waiting import wait_until

HTML = answer("503 Service Unavailable", b"<h1>Sorry</h1>", Retry_After="0")


@contextmanager
def meanwhile(work: Callable[[], object]) -> Iterator[None]:
    """Do something beside the block, which must end too."""
    thread = threading.Thread(target=work)
    thread.start()
    yield
    thread.join()


def done(either: Either, hand: Hand) -> Any:
    with hand.working():
        return either(either.client.watermark(asset(), "HI"))


def test_an_asset_is_sent_followed_and_fetched(either: Either, hand: Hand, tmp_path: Path) -> None:
    path = tmp_path / "spot.obj"
    path.write_bytes(asset())
    seen: list[tuple[str, str | None]] = []
    with hand.working():
        sent = either.client.watermark(
            path,
            "HI",
            metadata={"order": "4711"},
            color="none",
            on_progress=lambda job: seen.append((job.state, job.stage)),
        )
        job = either(sent)
    assert seen[-1] == ("succeeded", None)
    assert ("running", "placing") in seen
    assert (job.state, job.progress, job.metadata) == ("succeeded", 1.0, {"order": "4711"})
    assert job.facts["input"]["filename"] == "spot.obj"
    assert (job.facts["parameters"]["text"], job.facts["parameters"]["color"]) == ("HI", "none")
    assert either(job.download(tmp_path / "out.glb")).read_bytes() == MODEL
    assert either(job.report()) == REPORT
    assert either(job.preview()) == b"\x89PNG"
    assert either(either.client.get(job.id)).facts == job.facts


def test_a_small_job_takes_one_request(either: Either, hand: Hand, proxy: Proxy) -> None:
    job = done(either, hand)
    assert job.state == "succeeded"
    assert proxy.lines() == ["POST /v1/watermarks"]


def test_a_job_that_is_not_waited_for_can_be_waited_for_later(either: Either, hand: Hand) -> None:
    job = either(either.client.watermark(asset(), "HI", wait=False))
    assert (job.state, job.has_ended, job.problem) == ("queued", False, None)
    hand.do(job.id)
    assert either(job.refresh()).state == "succeeded"
    assert either(job.result()) is job


def test_a_job_that_fails_is_its_problem(either: Either, hand: Hand) -> None:
    with hand.working(), pytest.raises(MeshmarkProblem, match="No place for it") as raised:
        either(either.client.watermark(asset(), "HI", metadata={"fail": "yes"}))
    assert (raised.value.code, raised.value.remedy, raised.value.status) == ("no_placement", "Ask for less.", None)
    failed = either(either.client.get(raised.value.job_id))
    assert failed.state == "failed"
    assert either(failed.wait()).problem.code == "no_placement"


def test_a_request_that_is_refused_is_its_problem_at_once(either: Either, proxy: Proxy) -> None:
    with pytest.raises(MeshmarkProblem) as raised:
        either(either.client.watermark(asset(), "HI", size=-1.0))
    assert (raised.value.code, raised.value.status, raised.value.job_id) == ("invalid_parameters", 422, None)
    with pytest.raises(MeshmarkProblem) as raised:
        either(either.client.get("nothing/../here"))
    assert raised.value.code == "not_found"
    with pytest.raises(FileNotFoundError):
        either(either.client.watermark("nowhere.glb", "HI"))
    assert len(proxy.requests) == 2


def test_a_download_that_breaks_off_goes_on_from_there(
    either: Either, hand: Hand, proxy: Proxy, tmp_path: Path
) -> None:
    job = done(either, hand)
    get = f"GET /v1/watermarks/{job.id}/model"
    proxy.faults = [Fault(get, after=700_000), Fault(get, after=900_000)]
    assert either(job.download(tmp_path / "out.glb")).read_bytes() == MODEL
    first, *again = [request.headers for request in proxy.requests if request.line == get]
    assert "range" not in first
    starts = [int(request.start) for request in proxy.requests if request.line == get and request.start]
    assert 0 < starts[0] < starts[1] < len(MODEL)
    assert {headers["if-range"] for headers in again} == {f'"{job_sha(hand, job.id)}"'}
    assert [path.name for path in tmp_path.iterdir()] == ["out.glb"]


def job_sha(hand: Hand, job_id: str) -> str:
    job = hand.ledger.get(job_id, "alice")
    assert job is not None
    return next(part.sha256 for part in job.artifacts if part.kind == "model")


def test_parts_of_two_files_are_never_put_together(either: Either, hand: Hand, proxy: Proxy) -> None:
    job = done(either, hand)
    get = f"GET /v1/watermarks/{job.id}/model"
    other = answer("206 Partial Content", b"other", ETag='"other"', Content_Range="bytes START-9999999/10000000")
    proxy.faults = [Fault(get, after=700_000), Fault(get, answer=other)]
    assert either(job.content()) == MODEL
    assert len(proxy.lines(get)) == 3


def test_a_download_from_a_bucket_goes_on_too_and_the_key_stays_here(
    either: Either, hand: Hand, proxy: Proxy, edge: Edge
) -> None:
    job = done(either, hand)
    bucket = Proxy(edge.port)
    to_bucket = answer("307 Temporary Redirect", Location=f"http://localhost:{bucket.port}/object?signature=1")
    proxy.faults = [Fault("GET", answer=to_bucket)] * 2
    rest = answer("206 Partial Content", b"world", ETag='"1"', Content_Range="bytes 6-10/11")
    bucket.faults = [Fault("GET", answer=answer("200 OK", b"hello ", missing=5, ETag='"1"')), Fault("GET", answer=rest)]
    assert either(job.content()) == b"hello world"
    first, again = [request.headers for request in bucket.requests]
    assert "authorization" not in first | again
    assert (again["range"], again["if-range"]) == ("bytes=6-", '"1"')
    bucket.close()


def test_a_download_that_cannot_be_had_leaves_nothing_and_what_was_there_stays(
    either: Either, hand: Hand, tmp_path: Path
) -> None:
    job = done(either, hand)
    (tmp_path / "out.glb").write_bytes(b"before")
    with pytest.raises(MeshmarkProblem, match="credentials") as raised:
        either(job.download(tmp_path / "out.glb", "credentials"))
    assert raised.value.code == "not_found"
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"before"]


def test_a_service_that_is_busy_is_asked_again(either: Either, proxy: Proxy) -> None:
    proxy.faults = [Fault("POST", answer=HTML), Fault("POST", answer=answer("429 Too Many", Retry_After="0"))]
    job = either(either.client.watermark(asset(), "HI", wait=False))
    assert job.state == "queued"
    assert len({request.headers["idempotency-key"] for request in proxy.requests}) == 1
    assert len(proxy.requests) == 3


def test_past_a_proxy_that_is_impatient_no_answer_is_kept_back_again(either: Either, hand: Hand, proxy: Proxy) -> None:
    proxy.faults = [Fault("POST", answer=answer("504 Gateway Timeout", b"<h1>Too late</h1>"))]
    assert done(either, hand).state == "succeeded"
    first, again = [request.headers for request in proxy.requests if request.line.startswith("POST")]
    assert first["prefer"] == "wait=50"
    assert "prefer" not in again


def test_a_service_that_asks_for_an_hour_is_not_waited_for(either: Either, proxy: Proxy) -> None:
    proxy.faults = [Fault("POST", answer=answer("429 Too Many", Retry_After="3600"))]
    with pytest.raises(MeshmarkProblem) as raised:
        either(either.client.watermark(asset(), "HI", wait=False))
    assert (raised.value.code, raised.value.status) == ("unexpected_answer", 429)
    assert len(proxy.requests) == 1


def test_an_answer_that_gets_lost_makes_no_second_job(either: Either, proxy: Proxy) -> None:
    proxy.faults = [Fault("POST", after=0)]
    job = either(either.client.watermark(asset(), "HI", metadata={"lost": either.url}, wait=False))
    assert [each.id for each in either.all(either.client.jobs(metadata=("lost", either.url)))] == [job.id]
    assert len(proxy.lines("POST")) == 2


def test_a_stream_of_events_that_breaks_off_goes_on_from_the_last_one(
    either: Either, hand: Hand, proxy: Proxy, edge: Edge
) -> None:
    job = either(either.client.watermark(asset(), "HI", wait=False))
    events = f"GET /v1/watermarks/{job.id}/events"
    lease = hand.begin(job.id)
    proxy.faults = [Fault(events, after=1500)]  # the first events, and a piece of the next one
    seen: list[str | None] = []

    def go_on() -> None:
        wait_for_events(edge)
        for number, stage in enumerate(["placing", "embossing", "evaluating"]):
            hand.stage(lease, stage, 0.2 * number)
        wait_until(lambda: len(proxy.lines(events)) == 2)
        hand.succeed(lease)

    with meanwhile(go_on):
        either(job.wait(lambda job: seen.append(job.stage)))
    assert seen == [None, "reading", "placing", "embossing", "evaluating", None], "each once"
    assert [request.headers.get("last-event-id") is None for request in proxy.requests if request.line == events] == [
        True,
        False,
    ]


@pytest.mark.parametrize("refusal", [HTML, answer("200 OK", b"hello", Content_Type="text/html")])
def test_where_no_events_can_be_had_the_job_is_asked_for(
    either: Either, hand: Hand, proxy: Proxy, refusal: bytes
) -> None:
    job = either(either.client.watermark(asset(), "HI", wait=False))
    events = f"GET /v1/watermarks/{job.id}/events"
    proxy.faults = [Fault(events, answer=refusal)] * 5

    def go_on() -> None:
        wait_until(lambda: f"GET /v1/watermarks/{job.id}" in proxy.lines())
        hand.do(job.id)

    with meanwhile(go_on):
        either(job.result())
    assert job.state == "succeeded"
    assert len(proxy.lines(events)) <= 3


def test_many_assets_have_an_outcome_each(either: Either, hand: Hand, tmp_path: Path) -> None:
    good = [tmp_path / f"{name}.obj" for name in "abc"]
    for path in good:
        path.write_bytes(asset(number=path.name))
    (tmp_path / "no.glb").write_bytes(b"no model")
    assets = [*good, tmp_path / "no.glb", tmp_path / "missing.glb"]
    with hand.working():
        outcomes = either.all(either.client.watermark_all(assets, "HI", concurrency=2))
    by_asset = {Path(outcome.asset).name: outcome for outcome in outcomes}
    assert len(outcomes) == len(by_asset) == 5
    for path in good:
        assert by_asset[path.name].job.facts["input"]["filename"] == path.name
        assert by_asset[path.name].error is None
    assert by_asset["no.glb"].error.code == "unknown_format"
    assert isinstance(by_asset["missing.glb"].error, FileNotFoundError)


def test_no_more_assets_are_on_their_way_than_asked_for() -> None:
    there, most, lock = 0, 0, threading.Lock()
    full = threading.Barrier(3)

    def do(_asset: object) -> str:
        nonlocal there, most
        with lock:
            there += 1
            most = max(most, there)
        full.wait()
        with lock:
            there -= 1
        return "done"

    outcomes = list(all_of([b"%d" % number for number in range(9)], do, 3))
    assert [outcome.job for outcome in outcomes] == ["done"] * 9
    assert most == 3


def test_who_stops_asking_for_outcomes_ends_what_is_under_way(either: Either, hand: Hand) -> None:
    with hand.working():
        outcomes = either.client.watermark_all((asset(number=number) for number in range(100)), "HI", concurrency=2)

        async def first() -> Any:
            outcome = await anext(outcomes)
            await outcomes.aclose()
            return outcome

        outcome = either(first()) if hasattr(outcomes, "aclose") else next(outcomes)
        if not hasattr(outcomes, "aclose"):
            outcomes.close()
    assert outcome.job.state == "succeeded"


def test_lists_go_on_over_their_pages(either: Either, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operations, "PAGE", 2)
    mine = {"list": either.url}
    ids = [either(either.client.watermark(asset(), "HI", metadata=mine, wait=False)).id for _ in range(5)]
    assert [job.id for job in either.all(either.client.jobs(metadata=("list", either.url)))] == ids[::-1]
    assert either.all(either.client.jobs(state="failed", metadata=("list", either.url))) == []


def test_a_job_is_canceled_and_deleted(either: Either) -> None:
    job = either(either.client.watermark(asset(), "HI", wait=False))
    either(job.delete())
    assert either(job.refresh()).state == "canceled"
    with pytest.raises(MeshmarkProblem) as raised:
        either(job.result())
    assert raised.value.code == "job_canceled"


def test_a_suspect_file_is_verified(either: Either, hand: Hand, proxy: Proxy, tmp_path: Path) -> None:
    with hand.working():
        job = either(either.client.verify(asset(), texts=["HI"], filename="suspect.obj", metadata={"case": "7"}))
    assert job.facts["parameters"]["texts"] == ["HI"]
    assert proxy.lines() == ["POST /v1/verifications"]
    assert either(job.download(tmp_path / "evidence.html")).read_bytes() == b"<html>"
    assert either(job.report()) == REPORT
    assert job.id in [each.id for each in either.all(either.client.jobs("verifications"))]
    assert either(either.client.get(job.id, "verifications")).state == "succeeded"


def test_a_service_that_is_not_there_is_a_problem_too() -> None:
    with Client(f"http://127.0.0.1:{free_port()}", retries=1) as client, pytest.raises(MeshmarkProblem) as raised:
        client.watermark(asset(), "HI")
    assert (raised.value.code, raised.value.status) == ("unreachable", None)


def test_a_wrong_key_is_told(edge: Edge) -> None:
    with Client(f"http://127.0.0.1:{edge.port}", "mm_wrong") as client, pytest.raises(MeshmarkProblem) as raised:
        list(client.jobs())
    assert (raised.value.code, raised.value.status) == ("invalid_api_key", 401)
