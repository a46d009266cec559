import time
from base64 import urlsafe_b64encode
from collections.abc import Iterator

import pytest

from core.errors import ErrorCode, MeshmarkError
from service.jobs.ledger import Ledger, Submission
from service.jobs.listing import Filters, list_jobs
from service.jobs.models import Job, JobState

ALL = Filters()


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


def submit(ledger: Ledger, tenant: str = "acme", **metadata: str) -> Job:
    return ledger.create("asset.glb", {}, {}, lambda _: True, Submission(tenant, metadata))


def walk(ledger: Ledger, limit: int, filters: Filters = ALL, tenant: str = "acme") -> list[list[str]]:
    """The ids on each page."""
    pages, cursor = [], None
    while True:
        page = list_jobs(ledger.sessions, tenant, filters, limit, cursor)
        pages.append([job.id for job in page.jobs])
        if page.cursor is None:
            return pages
        cursor = page.cursor


def found(ledger: Ledger, **filters: object) -> list[str]:
    [page] = walk(ledger, 100, Filters(**filters))  # type: ignore[arg-type]
    return page


def test_every_job_is_on_one_page_newest_first(ledger: Ledger) -> None:
    jobs = [submit(ledger).id for _ in range(7)]
    pages = walk(ledger, 3)
    assert [len(page) for page in pages] == [3, 3, 1]
    assert [job_id for page in pages for job_id in page] == jobs[::-1]
    assert walk(ledger, 7) == [jobs[::-1]]


def test_jobs_of_the_same_moment_are_all_listed(ledger: Ledger, monkeypatch: pytest.MonkeyPatch) -> None:
    moment = submit(ledger).created_at
    monkeypatch.setattr("service.jobs.ledger.clock", lambda _: moment)
    jobs = {submit(ledger).id for _ in range(5)}
    listed = [job_id for page in walk(ledger, 2) for job_id in page]
    assert len(listed) == 6
    assert jobs < set(listed)


def test_jobs_that_come_meanwhile_shift_nothing(ledger: Ledger) -> None:
    jobs = [submit(ledger).id for _ in range(4)]
    first = list_jobs(ledger.sessions, "acme", Filters(), 2)
    submit(ledger)
    second = list_jobs(ledger.sessions, "acme", Filters(), 2, first.cursor)
    assert [job.id for job in first.jobs + second.jobs] == jobs[::-1]


def test_nobody_sees_the_jobs_of_others(ledger: Ledger) -> None:
    ours, theirs = submit(ledger, order="1").id, submit(ledger, "beta", order="1").id
    cursor = list_jobs(ledger.sessions, "acme", Filters(), 1).cursor
    assert walk(ledger, 10) == [[ours]]
    assert walk(ledger, 10, Filters(metadata=("order", "1")), "beta") == [[theirs]]
    assert cursor is None


def test_jobs_are_found_by_state_time_and_metadata(ledger: Ledger) -> None:
    first = submit(ledger, order="1", shop="north")
    time.sleep(0.001)
    second = submit(ledger, order="2", shop="north")
    time.sleep(0.001)
    third = submit(ledger)
    ledger.cancel(second.id, "acme")
    assert found(ledger, state=JobState.CANCELED) == [second.id]
    assert found(ledger, state=JobState.QUEUED) == [third.id, first.id]
    assert found(ledger, created_after=first.created_at) == [third.id, second.id]
    assert found(ledger, created_before=third.created_at) == [second.id, first.id]
    assert found(ledger, metadata=("shop", "north")) == [second.id, first.id]
    assert found(ledger, metadata=("shop", "north"), state=JobState.QUEUED) == [first.id]
    assert found(ledger, metadata=("order", "north")) == []
    assert found(ledger, metadata=("shop", "%")) == []


@pytest.mark.parametrize(
    "cursor",
    ["x", "%%%", "ä", "AAAA", urlsafe_b64encode(b"2026-13-45T00:00:00.000000 a").decode(), "A" * 201],
)
def test_a_cursor_that_is_none_is_refused(ledger: Ledger, cursor: str) -> None:
    with pytest.raises(MeshmarkError) as refused:
        list_jobs(ledger.sessions, "acme", Filters(), 10, cursor)
    assert refused.value.code == ErrorCode.INVALID_REQUEST
