"""Copies of a job, asked for with it and after it."""

import io
import json
import zipfile
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from httpx2 import Response
from sqlalchemy import select, update

from service.archive import Entry, archived
from service.config import Settings
from service.jobs.clock import now
from service.jobs.dead import WORKER_LOST, retry
from service.jobs.folder_store import FolderStore
from service.jobs.ledger_metrics import LedgerCollector
from service.jobs.models import Artifact, ArtifactKind, Job, Tenant, WebhookDelivery
from tests.service.conftest import Client, client_with
from tests.worker.engines import asset
from worker.sweeper import remove_expired

TEXTS = ["ORDER-1", "ORDER-22", "ORDER-3"]
COPIES = [{"text": text, "metadata": {"customer": text[-1]}} for text in TEXTS]


def post(client: Client, copies: Any = None, content: bytes | None = None, **headers: str) -> Response:
    data = {"params": '{"text": "HI"}'} | ({} if copies is None else {"copies": json.dumps(copies)})
    files = {"file": ("asset.obj", asset() if content is None else content)}
    return client.http.post("/v1/watermarks", data=data, files=files, headers=headers)


def succeeded(client: Client, copies: Any = None) -> str:
    """The URL of a job that has succeeded."""
    url = str(post(client, copies).headers["Location"])
    client.run(url)
    assert client.http.get(url).json()["state"] == "succeeded"
    return url


def more(client: Client, url: str, copies: Any, **headers: str) -> Response:
    return client.http.post(f"{url}/copies", json={"copies": copies}, headers=headers)


def listed(client: Client, url: str) -> list[dict[str, Any]]:
    return list(client.http.get(f"{url}/copies", params={"limit": 100}).json()["items"])


def states(client: Client, url: str) -> list[str]:
    return [copy["state"] for copy in listed(client, url)]


def test_copies_wait_for_their_job_and_take_its_places(client: Client) -> None:
    url = str(post(client, COPIES).headers["Location"])
    waiting = listed(client, url)
    assert [(copy["text"], copy["state"], copy["metadata"]["customer"]) for copy in waiting] == [
        (text, "queued", text[-1]) for text in TEXTS
    ]
    client.run(waiting[0]["links"]["self"])  # a message about any job starts that whose turn it is
    assert client.http.get(url).json()["state"] == "succeeded"
    assert json.loads(client.http.get(f"{url}/plan").content)["parameters"]["text"] == "ORDER-22", "the longest"
    for _ in TEXTS:
        client.run(url)
    for copy, text in zip(listed(client, url), TEXTS, strict=True):
        job = client.http.get(copy["links"]["self"]).json()
        assert (job["state"], job["copy_of"], job["priority"]) == ("succeeded", url.rsplit("/", 1)[1], "low")
        assert (job["links"]["plan"], job["links"]["preview"], job["parameters"]["evaluate"]) == (None, None, "none")
        model = client.http.get(copy["links"]["model"])
        assert model.content == b"glTF of " + text.encode()
        assert f'filename="asset-{text}.watermarked.glb"' in model.headers["Content-Disposition"]
        assert client.http.get(copy["links"]["report"]).json()["placed_for"] == "ORDER-22"


def test_a_job_that_has_succeeded_is_copied_and_one_that_has_not_is_not(client: Client) -> None:
    url = str(post(client).headers["Location"])
    early = more(client, url, COPIES)
    assert (early.status_code, early.json()["code"]) == (409, "not_ready")
    client.run(url)
    made = more(client, url, COPIES)
    assert made.status_code == 202
    assert made.headers["Location"] == f"{url}/copies"
    assert [copy["text"] for copy in made.json()["items"]] == TEXTS
    client.run(url)
    first = listed(client, url)[0]
    assert first["state"] == "succeeded"
    again = more(client, first["links"]["self"], COPIES)
    assert (again.status_code, again.json()["code"]) == (404, "not_found"), "a copy has no plan of its own"
    unknown = more(client, "/v1/watermarks/nobody", COPIES)
    assert (unknown.status_code, unknown.json()["code"]) == (404, "not_found")


def test_a_copy_whose_job_fails_has_its_error_and_its_webhook(client: Client) -> None:
    url = str(post(client, COPIES, asset("refuse")).headers["Location"])
    client.run(url)
    job = client.http.get(url).json()
    assert job["state"] == "failed"
    assert [(copy["state"], copy["error"]) for copy in listed(client, url)] == [("failed", job["error"])] * 3


def test_deleting_a_job_cancels_copies_that_wait_for_it_and_keeps_those_that_do_not(client: Client) -> None:
    early = str(post(client, COPIES).headers["Location"])
    assert client.http.delete(early).status_code == 204
    assert states(client, early) == ["canceled"] * 3
    url = succeeded(client, COPIES)
    assert client.http.delete(url).status_code == 204
    for _ in TEXTS:
        client.run(url)
    assert states(client, url) == ["succeeded"] * 3
    gone = more(client, url, COPIES)
    assert (gone.status_code, gone.json()["code"]) == (410, "job_expired")
    for copy in listed(client, url):
        assert client.http.delete(copy["links"]["self"]).status_code == 204
        forgotten = client.http.get(copy["links"]["model"])
        assert (forgotten.status_code, forgotten.json()["code"]) == (410, "job_expired")
    assert [*client.artifacts.listing()] == []


def test_a_copy_that_was_canceled_stays_so_when_its_job_succeeds(client: Client) -> None:
    url = str(post(client, COPIES).headers["Location"])
    assert client.http.delete(listed(client, url)[1]["links"]["self"]).status_code == 204
    client.run(url)
    client.run(url)
    client.run(url)
    assert states(client, url) == ["succeeded", "canceled", "succeeded"]


def test_copies_whose_job_loses_its_worker_for_good_fail(client: Client) -> None:
    url = str(post(client, COPIES).headers["Location"])
    ledger = client.worker.ledger
    assert ledger.claim(url.rsplit("/", 1)[1], lease_seconds=-1)
    ledger.recover(1, WORKER_LOST)
    assert [copy["error"]["code"] for copy in listed(client, url)] == ["worker_lost"] * 3


def test_a_copy_that_lost_its_worker_is_retried_as_a_copy(client: Client) -> None:
    url = succeeded(client)
    [copy] = more(client, url, COPIES[:1]).json()["items"]
    ledger = client.worker.ledger
    assert ledger.claim(copy["id"], lease_seconds=-1)
    ledger.recover(1, WORKER_LOST)
    again = retry(ledger, client.artifacts, copy["id"])
    client.run(f"/{again.id}")
    assert [(each["text"], each["state"]) for each in listed(client, url)] == [
        ("ORDER-1", "failed"),
        ("ORDER-1", "succeeded"),
    ]


def test_no_sweeper_announces_copies_that_are_held_back(client: Client) -> None:
    url = str(post(client, COPIES).headers["Location"])
    ledger = client.worker.ledger
    assert ledger.waiting(-1) == [url.rsplit("/", 1)[1]]
    families = {family.name: family for family in LedgerCollector(ledger.sessions).collect()}
    assert sum(sample.value for sample in families["meshmark_jobs"].samples) == 1
    job = ledger.claim(url.rsplit("/", 1)[1], lease_seconds=60)
    assert job
    assert ledger.succeed(job.lease)
    assert ledger.waiting(-1) == [copy["id"] for copy in listed(client, url)]


def test_files_are_kept_for_copies_and_counted_for_each(client: Client) -> None:
    def counted() -> int:
        with ledger.sessions() as session:
            return session.scalars(select(Tenant.stored_bytes)).one()

    ledger = client.worker.ledger
    url = succeeded(client)
    before = counted()
    more(client, url, COPIES)
    with ledger.sessions.begin() as session:
        files = session.execute(select(Artifact.kind, Artifact.size).where(Artifact.job_id == url.rsplit("/", 1)[1]))
        shared = sum(size for kind, size in files if kind in (ArtifactKind.INPUT, ArtifactKind.PLAN))
        session.execute(update(Job).where(Job.copy_of.is_(None)).values(purge_at=now() - timedelta(days=1)))
    assert counted() == before + 3 * shared
    remove_expired(client.worker)
    for _ in TEXTS:
        client.run(url)
    assert states(client, url) == ["succeeded"] * 3


def test_a_page_ends_where_the_next_begins_and_an_index_has_all(client: Client) -> None:
    url = str(post(client, COPIES).headers["Location"])
    first = client.http.get(f"{url}/copies", params={"limit": 2}).json()
    second = client.http.get(first["next"]).json()
    assert [copy["text"] for copy in first["items"] + second["items"]] == TEXTS
    assert second["next"] is None
    index = client.http.get(f"{url}/copies", headers={"Accept": "application/x-ndjson"})
    assert index.headers["Content-Type"] == "application/x-ndjson"
    assert [json.loads(line) for line in index.text.splitlines()] == first["items"] + second["items"]
    wrong = client.http.get(f"{url}/copies", params={"cursor": "x"})
    assert (wrong.status_code, wrong.json()["code"]) == (400, "invalid_request")


def test_the_same_request_with_its_key_makes_no_more_copies(client: Client) -> None:
    url = succeeded(client)
    key = {"Idempotency-Key": '"once"'}
    made = more(client, url, COPIES, **key)
    more(client, url, [{"text": "OTHER"}])
    replayed = more(client, url, COPIES, **key)
    assert replayed.headers["Idempotent-Replayed"] == "true"
    assert replayed.json() == made.json()
    other = more(client, url, COPIES[:2], **key)
    assert (other.status_code, other.json()["code"]) == (422, "idempotency_key_reused")
    assert len(listed(client, url)) == 4
    asked = [post(client, COPIES, None, **{"Idempotency-Key": '"twice"'}) for _ in range(2)]
    assert asked[0].json()["id"] == asked[1].json()["id"]
    assert len(listed(client, asked[0].headers["Location"])) == 3
    differing = post(client, COPIES[:2], None, **{"Idempotency-Key": '"twice"'})
    assert (differing.status_code, differing.json()["code"]) == (422, "idempotency_key_reused")


def test_copies_of_a_job_with_results_of_an_earlier_one_start_at_once(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path, cache=True)) as client:
        succeeded(client, COPIES)
        again = post(client, COPIES)
        assert (again.json()["state"], again.json()["cached"]) == ("succeeded", True)
        for _ in range(6):
            client.run(again.headers["Location"])
        assert states(client, again.headers["Location"]) == ["succeeded"] * 3
        others = post(client, COPIES[:2])
        assert others.json()["state"] == "queued", "its places are to have room for other texts"


REFUSED = {
    "a text": ("copies", "invalid_parameters", "valid array"),
    "not a list": ({"text": "a"}, "invalid_parameters", "valid array"),
    "none": ([], "invalid_parameters", "at least 1"),
    "too many": ([{"text": str(number)} for number in range(1001)], "invalid_parameters", "at most 1000"),
    "no text": ([{}], "invalid_parameters", "0.text"),
    "spaces": ([{"text": "a"}, {"text": " "}], "empty_text", "copies.1"),
    "a long text": ([{"text": "a" * 201}], "invalid_parameters", "0.text"),
    "seven lines": ([{"text": "a\nb\nc\nd\ne\nf\ng"}], "invalid_parameters", "copies.0"),
    "letters that no font has": ([{"text": "\U0001f984"}], "missing_glyphs", "copies.0"),
    "a text twice": ([{"text": "ab"}, {"text": "b"}, {"text": " ab"}], "invalid_parameters", "copies.2"),
    "wrong metadata": ([{"text": "a", "metadata": {"a": 1}}], "invalid_metadata", "copies.0"),
    "unknown fields": ([{"text": "a", "count": 3}], "invalid_parameters", "count"),
}


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with client_with(Settings(data_dir=tmp_path_factory.mktemp("shop"))) as client:
        yield client


@pytest.mark.parametrize(("copies", "code", "said"), REFUSED.values(), ids=REFUSED.keys())
def test_wrong_copies_are_refused_before_anything_is_made(shop: Client, copies: Any, code: str, said: str) -> None:
    response = post(shop, copies)
    assert (response.status_code, response.json()["code"]) == (422, code), response.text
    assert said in response.json()["detail"]
    assert shop.http.get("/v1/watermarks").json()["items"] == []
    assert [*shop.artifacts.listing()] == []


def test_copies_need_marks_and_count_as_jobs(tmp_path_factory: pytest.TempPathFactory) -> None:
    with client_with(Settings(data_dir=tmp_path_factory.mktemp("few"), max_active_jobs=3)) as client:
        label = {"params": '{"label": "eu", "metadata_only": true}', "copies": json.dumps(COPIES)}
        bare = client.http.post("/v1/watermarks", data=label, files={"file": ("a.obj", asset())})
        assert (bare.status_code, bare.json()["code"]) == (422, "invalid_parameters")
        many = post(client, COPIES)
        assert (many.status_code, many.json()["code"]) == (429, "too_many_jobs")
        assert client.http.get("/v1/watermarks").json()["items"] == []
        url = succeeded(client)
        assert more(client, url, COPIES[:2]).status_code == 202
        assert more(client, url, COPIES[:2]).status_code == 429
        assert len(listed(client, url)) == 2
        huge = more(client, url, [{"text": str(number), "metadata": {"a": "x" * 99}} for number in range(100_000)])
        assert (huge.status_code, huge.json()["code"]) == (413, "upload_too_large")


def test_a_webhook_is_sent_for_each_copy(client: Client) -> None:
    endpoint = client.http.post("/v1/webhook-endpoints", json={"url": "https://shop.example/hooks"})
    assert endpoint.status_code == 201, endpoint.text
    url = succeeded(client, COPIES)
    with client.worker.ledger.sessions() as session:
        told = sorted(session.scalars(select(WebhookDelivery.job_id)))
    assert told == sorted([url.rsplit("/", 1)[1], *(copy["id"] for copy in listed(client, url))])


@pytest.fixture
def reusing(tmp_path: Path) -> Iterator[Client]:
    """One that gives results of earlier jobs."""
    with client_with(Settings(data_dir=tmp_path, cache=True)) as client:
        yield client


def test_a_copy_equal_to_an_earlier_one_has_its_results_at_once(reusing: Client) -> None:
    url = succeeded(reusing, COPIES)
    again = more(reusing, url, [*COPIES[:2], {"text": "OTHER"}]).json()["items"]
    assert [copy["state"] for copy in again] == ["succeeded", "succeeded", "queued"]
    jobs = [reusing.http.get(copy["links"]["self"]).json() for copy in again]
    assert [job["cached"] for job in jobs] == [True, True, False]
    assert [copy["metadata"] for copy in again[:2]] == [copy["metadata"] for copy in COPIES[:2]]
    first, served = (reusing.http.get(listed(reusing, url)[place]["links"]["model"]) for place in (0, 3))
    assert (served.content, served.headers["ETag"]) == (first.content, first.headers["ETag"])
    assert jobs[0]["links"]["report"] is not None
    anew = reusing.http.post(f"{url}/copies?cache=false", json={"copies": COPIES[:1]}).json()["items"]
    assert [copy["state"] for copy in anew] == ["queued"]


def test_a_job_that_is_sent_again_has_its_copies_at_once(reusing: Client) -> None:
    succeeded(reusing, COPIES)
    url = str(post(reusing, COPIES).headers["Location"])
    assert (reusing.http.get(url).json()["cached"], states(reusing, url)) == (True, ["succeeded"] * 3)
    with reusing.worker.ledger.sessions() as session:
        assert not list(session.scalars(select(Job.id).where(Job.state == "queued")))


def test_copies_that_waited_take_the_results_of_equal_ones(reusing: Client) -> None:
    """Their job is made anew and has the same plan."""
    succeeded(reusing, COPIES)
    longer = [*COPIES, {"text": "ORDER-4"}]
    url = str(post(reusing, longer).headers["Location"])
    assert states(reusing, url) == ["queued"] * 4
    reusing.run(url)
    jobs = [reusing.http.get(copy["links"]["self"]).json() for copy in listed(reusing, url)]
    assert [(job["state"], job["cached"]) for job in jobs] == [("succeeded", True)] * 3 + [("succeeded", False)]


def test_results_at_other_places_and_of_deleted_or_expired_copies_are_not_taken(reusing: Client) -> None:
    url = succeeded(reusing, COPIES)
    other = str(post(reusing, COPIES[:1], asset(other=1)).headers["Location"])
    reusing.run(other)
    assert [reusing.http.get(copy["links"]["self"]).json()["cached"] for copy in listed(reusing, other)] == [False]
    reusing.http.delete(listed(reusing, url)[0]["links"]["self"])
    assert [copy["state"] for copy in more(reusing, url, COPIES[:2]).json()["items"]] == ["queued", "succeeded"]
    with reusing.worker.ledger.sessions.begin() as session:
        session.execute(update(Job).where(Job.copy_of.is_not(None)).values(expires_at=now() - timedelta(days=1)))
    assert [copy["state"] for copy in more(reusing, url, COPIES[1:2]).json()["items"]] == ["queued"]


def archive(client: Client, url: str) -> zipfile.ZipFile:
    answer = client.http.get(f"{url}/copies.zip")
    assert (answer.status_code, answer.headers["Content-Type"]) == (200, "application/zip"), answer.text
    assert answer.headers["Content-Disposition"] == 'attachment; filename="asset.copies.zip"'
    return zipfile.ZipFile(io.BytesIO(answer.content))


def test_all_copies_come_in_one_archive_with_an_index(client: Client) -> None:
    instead: dict[str, Any] = {"for": {"ORDER-22": "refuse"}}
    content = asset(**instead)
    url = str(post(client, [*COPIES, {"text": "ORDER/3"}], content).headers["Location"])
    early = client.http.get(f"{url}/copies.zip")
    assert (early.status_code, early.json()["code"]) == (409, "not_ready")
    for _ in range(3):
        client.run(url)
    with archive(client, url) as found:
        assert found.testzip() is None
        *names, index = found.namelist()
        last = listed(client, url)[3]["id"]
        assert names == [
            "asset-ORDER-1.watermarked.glb",
            "asset-ORDER-3.watermarked.glb",
            f"asset-ORDER-3-{last}.watermarked.glb",
        ]
        assert [found.read(name) for name in names] == [b"glTF of ORDER-1", b"glTF of ORDER-3", b"glTF of ORDER/3"]
        lines = [json.loads(line) for line in found.read(index).decode().splitlines()]
    assert [(line["text"], line["file"]) for line in lines] == [
        ("ORDER-1", names[0]),
        ("ORDER-22", None),
        ("ORDER-3", names[1]),
        ("ORDER/3", names[2]),
    ]
    assert lines[1]["error"]["code"] == "no_placement"
    assert lines[0]["metadata"] == {"customer": "1"}


def test_there_is_no_archive_without_copies(client: Client) -> None:
    url = succeeded(client)
    assert client.http.get(f"{url}/copies.zip").json()["code"] == "not_found"


def test_an_archive_is_sent_as_it_is_read_and_breaks_off_where_a_file_is_gone(tmp_path: Path) -> None:
    """Of each file no more than a piece is in memory."""
    store = FolderStore(tmp_path)
    files = []
    for number in range(3):
        with store.stage(io.BytesIO(bytes([number]) * 2**22), limit=2**22, name="model") as staged:
            store.put(staged)
            files.append(Artifact(job_id="1", kind=ArtifactKind.MODEL, sha256=staged.sha256, size=staged.size))
    pieces = list(archived(store, [Entry(f"{number}.glb", file) for number, file in enumerate(files)]))
    assert max(map(len, pieces)) < 2**21
    with zipfile.ZipFile(io.BytesIO(b"".join(pieces))) as found:
        assert [found.read(name) for name in found.namelist()] == [bytes([number]) * 2**22 for number in range(3)]
    store.remove(files[1].sha256)
    with pytest.raises(FileNotFoundError):
        list(archived(store, [Entry(f"{number}.glb", file) for number, file in enumerate(files)]))
