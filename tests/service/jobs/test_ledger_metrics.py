from collections.abc import Iterator

import pytest
from prometheus_client import Metric
from sqlalchemy import create_engine
from sqlalchemy.orm import sessionmaker

from core.errors import ErrorCode, MeshmarkError
from service.jobs.ledger import Ledger, Submission
from service.jobs.ledger_metrics import LedgerCollector
from service.jobs.models import DEFAULT_TENANT, Queue
from service.webhooks.endpoints import create_endpoint
from tests.service.harness import free_port
from tests.service.metrics import label_values, value


@pytest.fixture
def ledger(database_url: str) -> Iterator[Ledger]:
    ledger = Ledger(database_url)
    yield ledger
    ledger.close()


def figures(ledger: Ledger) -> list[Metric]:
    return list(LedgerCollector(ledger.sessions).collect())


def test_jobs_that_wait_and_run_are_counted_and_those_that_ended_are_not(ledger: Ledger) -> None:
    assert value(figures(ledger), "meshmark_jobs") == 0
    assert value(figures(ledger), "meshmark_queue_oldest_seconds") == 0
    jobs = [ledger.create("a.obj", {}, {}, lambda _: True) for _ in range(4)]
    first, second = (ledger.claim(job.id, 60) for job in jobs[:2])
    assert first is not None
    assert second is not None
    ledger.succeed(first.lease)
    answer = figures(ledger)
    assert value(answer, "meshmark_ledger_up") == 1
    assert value(answer, "meshmark_jobs", state="running") == 1
    assert value(answer, "meshmark_jobs", state="queued") == 2
    assert 0 < value(answer, "meshmark_queue_oldest_seconds") < 60
    ledger.fail(second.lease, MeshmarkError(ErrorCode.NO_FACES, "", ""))
    assert value(figures(ledger), "meshmark_jobs", state="running") == 0


def test_each_queue_has_figures_of_its_own_that_are_there_while_it_is_empty(ledger: Ledger) -> None:
    for queue in (Queue.LARGE, Queue.LARGE, Queue.SMALL):
        ledger.create("a.obj", {}, {}, lambda _: True, Submission(queue=queue))
    answer = figures(ledger)
    waiting = {queue: value(answer, "meshmark_jobs", state="queued", queue=queue) for queue in Queue}
    assert waiting == {Queue.SMALL: 1, Queue.LARGE: 2, Queue.GPU: 0}
    oldest = {queue: value(answer, "meshmark_queue_oldest_seconds", queue=queue) > 0 for queue in Queue}
    assert oldest == {Queue.SMALL: True, Queue.LARGE: True, Queue.GPU: False}
    assert label_values(answer, "queue") == set(Queue)


def test_webhooks_that_are_to_be_sent_are_counted(ledger: Ledger) -> None:
    assert value(figures(ledger), "meshmark_webhooks_pending") == 0
    create_endpoint(ledger.sessions, DEFAULT_TENANT, "https://shop.example/hook", ["watermark.canceled"], None)
    ledger.cancel(ledger.create("a.obj", {}, {}, lambda _: True).id)
    assert value(figures(ledger), "meshmark_webhooks_pending") == 1


def test_a_ledger_that_does_not_answer_is_told_and_nothing_is_made_up() -> None:
    sessions = sessionmaker(create_engine(f"postgresql+psycopg://nobody@127.0.0.1:{free_port()}/nothing"))
    answer = list(LedgerCollector(sessions).collect())
    assert [(family.name, family.samples[0].value) for family in answer] == [("meshmark_ledger_up", 0)]
