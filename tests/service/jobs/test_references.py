from collections.abc import Iterator
from contextlib import closing

import pytest

from service.jobs.forgetting import drop_artifacts
from service.jobs.ledger import Content, Ledger
from service.jobs.models import ArtifactKind
from service.jobs.references import discard, unreferenced

CONTENT = Content("ab" * 32, 3)


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    with closing(Ledger(database_url)) as ledger:
        yield ledger


def create(ledger: Ledger) -> str:
    return ledger.create("asset.glb", {}, {ArtifactKind.INPUT: CONTENT}, lambda _: True).id


def test_content_is_removed_when_the_last_job_has_let_go_of_it(ledger: Ledger) -> None:
    removed: list[str] = []
    first, second = create(ledger), create(ledger)
    for job_id, expected in ((first, []), (second, [CONTENT.sha256])):
        ledger.cancel(job_id)
        assert drop_artifacts(ledger.sessions, job_id) == {CONTENT.sha256}
        discard(ledger.sessions, CONTENT.sha256, removed.append)
        assert removed == expected
        assert unreferenced(ledger.sessions, [CONTENT.sha256]) == set(expected)
