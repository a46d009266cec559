import io
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from service.jobs import contents
from service.jobs.artifacts import ArtifactStore
from service.jobs.ledger import Ledger
from service.jobs.models import ArtifactKind, Job
from service.jobs.ownership import ForeignStoreError, adopt, claim


@pytest.fixture
def ledgers(tmp_path: Path) -> Iterator[list[Ledger]]:
    ledgers = [Ledger(f"sqlite:///{tmp_path / name}") for name in ("first", "second")]
    yield ledgers
    for ledger in ledgers:
        ledger.close()


def keep(ledger: Ledger, store: ArtifactStore, content: bytes) -> Job:
    with store.stage(io.BytesIO(content), limit=100, name="file") as staged:
        return contents.create_job(ledger, store, "asset.obj", {"text": "HI"}, {ArtifactKind.INPUT: staged})


def put(store: ArtifactStore, content: bytes) -> str:
    with store.stage(io.BytesIO(content), limit=100, name="file") as staged:
        store.put(staged)
        return staged.sha256


def test_a_ledger_keeps_its_identity_and_no_two_have_the_same(ledgers: list[Ledger], tmp_path: Path) -> None:
    first, second = ledgers
    again = Ledger(f"sqlite:///{tmp_path / 'first'}")
    assert again.identity == first.identity != second.identity
    again.close()


def test_an_empty_store_becomes_that_of_the_first_ledger_that_uses_it(
    store: ArtifactStore, ledgers: list[Ledger]
) -> None:
    first, second = ledgers
    claim(first, store)
    claim(first, store)
    with pytest.raises(ForeignStoreError, match=f"belongs to the database {first.identity}.*adopt-store"):
        claim(second, store)
    assert store.owner() == first.identity
    assert list(store.listing()) == []


def test_a_new_ledger_on_an_old_store_deletes_nothing(store: ArtifactStore, ledgers: list[Ledger]) -> None:
    first, second = ledgers
    claim(first, store)
    job = keep(first, store, b"precious")
    with pytest.raises(ForeignStoreError):
        contents.discard_orphans(second, store, grace=-60)
    source = job.artifact(ArtifactKind.INPUT)
    assert source is not None
    assert store.has(source.sha256)


def test_a_store_without_a_mark_is_taken_over_by_the_ledger_that_knows_all_of_it(
    store: ArtifactStore, ledgers: list[Ledger]
) -> None:
    first, second = ledgers
    keep(first, store, b"first's")
    with pytest.raises(ForeignStoreError, match="no mark"):
        claim(second, store)
    claim(first, store)
    assert store.owner() == first.identity


def test_a_store_without_a_mark_is_left_alone_if_one_thing_in_it_is_unknown(
    store: ArtifactStore, ledgers: list[Ledger]
) -> None:
    keep(ledgers[0], store, b"known")
    unknown = put(store, b"unknown")
    with pytest.raises(ForeignStoreError, match="does not refer to"):
        contents.discard_orphans(ledgers[0], store, grace=-60)
    assert store.owner() is None
    assert store.has(unknown)


def test_an_operator_may_hand_a_store_over(store: ArtifactStore, ledgers: list[Ledger]) -> None:
    first, second = ledgers
    claim(first, store)
    adopt(second, store)
    claim(second, store)
    with pytest.raises(ForeignStoreError):
        contents.discard_orphans(first, store, grace=-60)


def test_of_ledgers_that_come_at_once_one_gets_the_store(store: ArtifactStore, ledgers: list[Ledger]) -> None:
    def try_to_claim(ledger: Ledger) -> bool:
        try:
            claim(ledger, store)
        except ForeignStoreError:
            return False
        return True

    with ThreadPoolExecutor(8) as pool:
        outcomes = list(pool.map(try_to_claim, ledgers * 4))
    winner = next(ledger for ledger in ledgers if ledger.identity == store.owner())
    assert outcomes == [ledger is winner for ledger in ledgers * 4]
