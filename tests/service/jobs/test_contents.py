import io
import random
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from service.jobs import contents
from service.jobs.artifacts import ArtifactStore, StoreUnavailableError
from service.jobs.forgetting import drop_artifacts
from service.jobs.ledger import Ledger
from service.jobs.models import ArtifactKind, Job
from service.jobs.ownership import claim
from service.jobs.references import discard
from service.jobs.stores import open_store
from tests.service.s3 import S3, Flaky, bucket_settings
from tests.worker.waiting import PATIENCE

INPUT, MODEL = ArtifactKind.INPUT, ArtifactKind.MODEL


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


def submit(ledger: Ledger, store: ArtifactStore, content: bytes) -> Job:
    with store.stage(io.BytesIO(content), limit=len(content), name="file") as staged:
        return contents.create_job(ledger, store, "asset.glb", {}, {INPUT: staged})


def delete(ledger: Ledger, store: ArtifactStore, job_id: str) -> None:
    ledger.cancel(job_id)
    contents.discard(ledger, store, drop_artifacts(ledger.sessions, job_id))


def names(store: ArtifactStore) -> list[str]:
    return [item.sha256 for item in store.listing()]


def test_content_lives_as_long_as_one_job_refers_to_it(ledger: Ledger, store: ArtifactStore) -> None:
    first, second = submit(ledger, store, b"1"), submit(ledger, store, b"1")
    assert len(names(store)) == 1
    delete(ledger, store, first.id)
    assert len(names(store)) == 1
    delete(ledger, store, second.id)
    assert names(store) == []


def test_content_removed_between_storing_and_recording_is_stored_again(ledger: Ledger, store: ArtifactStore) -> None:
    looked = []

    def has(sha256: str) -> bool:
        looked.append(sha256)
        if len(looked) == 1:  # in the transaction
            store.remove(sha256)
        return type(store).has(store, sha256)

    with store.stage(io.BytesIO(b"1"), limit=1, name="file") as staged:
        store.has = has  # type: ignore[method-assign]
        contents.create_job(ledger, store, "asset.glb", {}, {INPUT: staged})
    assert names(store) == [staged.sha256]
    assert len(looked) == 2


def test_an_upload_takes_the_same_way_whether_or_not_somebody_has_its_bytes(
    ledger: Ledger, store: ArtifactStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the time of an answer would tell that another tenant has them."""
    calls: list[str] = []

    def noting(name: str, method: Callable[[Any], Any]) -> Callable[[Any], Any]:
        def note(item: Any) -> Any:
            calls.append(name)
            return method(item)

        return note

    for name in ("has", "put"):
        monkeypatch.setattr(store, name, noting(name, getattr(store, name)))
    ways = []
    for _ in range(2):
        calls.clear()
        submit(ledger, store, b"1")
        ways.append(list(calls))
    assert ways == [["put", "has"]] * 2


def test_however_uploads_and_deletions_of_one_content_race_no_job_loses_its_file(
    ledger: Ledger, store: ArtifactStore
) -> None:
    """Four clients upload and delete the same two files, while a sweeper without any grace removes what it can."""
    claim(ledger, store)
    over = threading.Event()

    def use(seed: int) -> list[tuple[str, str]]:
        chance, kept = random.Random(seed), []
        for _ in range(12):
            job = submit(ledger, store, chance.choice([b"one", b"two"]))
            if chance.random() < 0.8:
                delete(ledger, store, job.id)
            else:
                kept.append((job.id, job.artifacts[0].sha256))
        return kept

    def sweep() -> None:
        while not over.wait(0.002):
            contents.discard_orphans(ledger, store, grace=0)

    with ThreadPoolExecutor(5) as pool:
        sweeper = pool.submit(sweep)
        try:
            kept = [item for items in pool.map(use, range(4)) for item in items]
        finally:
            over.set()
        sweeper.result()
    assert sorted(names(store)) == sorted({sha256 for _, sha256 in kept})


def test_a_race_between_storing_and_a_slow_removal_waits_for_the_removal(ledger: Ledger, store: ArtifactStore) -> None:
    """The remover has looked for references and found none; an upload of the same content comes while it deletes."""
    deleting, events = threading.Event(), []
    with store.stage(io.BytesIO(b"1"), limit=1, name="file") as staged:
        store.put(staged)

    def slowly(sha256: str) -> None:
        deleting.set()
        time.sleep(0.3)
        store.remove(sha256)
        events.append("removed")

    with ThreadPoolExecutor(1) as pool:
        removal = pool.submit(discard, ledger.sessions, staged.sha256, slowly)
        assert deleting.wait(PATIENCE)
        submit(ledger, store, b"1")
        events.append("recorded")
        removal.result()
    assert events == ["removed", "recorded"]
    assert names(store) == [staged.sha256]


def test_an_output_of_a_worker_that_lost_its_lease_leaves_nothing(ledger: Ledger, store: ArtifactStore) -> None:
    job = ledger.claim(submit(ledger, store, b"1").id, 60)
    assert job is not None
    ledger.cancel(job.id)
    with store.stage(io.BytesIO(b"2"), limit=1, name="model") as staged:
        assert not contents.publish(ledger, store, job.lease, MODEL, staged)
    assert names(store) == [job.artifacts[0].sha256]


def test_orphans_are_removed_when_they_are_old_and_only_they(ledger: Ledger, store: ArtifactStore) -> None:
    claim(ledger, store)
    kept = submit(ledger, store, b"kept").artifacts[0].sha256
    with ExitStack() as stack:
        orphans = [stack.enter_context(store.stage(io.BytesIO(b"%d" % n), limit=9, name="file")) for n in range(3)]
        for orphan in orphans:
            store.put(orphan)
    assert contents.discard_orphans(ledger, store, grace=60) == set()
    assert len(names(store)) == 4
    time.sleep(1.1)  # S3 tells ages in seconds
    first = orphans[0].sha256
    assert first in contents.discard_orphans(ledger, store, first[:2], grace=0)
    contents.discard_orphans(ledger, store, grace=0)
    assert names(store) == [kept]


def test_while_the_store_fails_nothing_is_recorded_and_deletions_are_left_for_later(
    ledger: Ledger, s3: S3, tmp_path: Path
) -> None:
    with Flaky(s3.url).running() as flaky:
        bucket = s3.new_bucket()
        bucket.endpoint = flaky.url
        store = open_store(bucket_settings(bucket, tmp_path))
        claim(ledger, store)
        job = submit(ledger, store, b"1")
        flaky.failing.set()
        with pytest.raises(StoreUnavailableError):
            submit(ledger, store, b"2")
        delete(ledger, store, job.id)
        assert flaky.failed > 2
        flaky.failing.clear()
        assert ledger.waiting(0) == []
        assert names(store) == [job.artifacts[0].sha256]
        time.sleep(1.1)
        contents.discard_orphans(ledger, store, grace=0)
        assert names(store) == []
