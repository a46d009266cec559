from collections.abc import Iterator
from pathlib import Path

import pytest
from celery import Celery

from service.config import Settings
from service.jobs.models import Queue
from service.jobs.queue import create_queue, depth
from service.webhooks import queue
from tests.service.harness import redis_server
from worker.webhooks import create_sender


@pytest.fixture(params=["files", "redis"])
def settings(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Settings]:
    if request.param == "files":
        yield Settings(data_dir=tmp_path)
        return
    with redis_server(tmp_path) as url:
        yield Settings(data_dir=tmp_path, broker_url=url)


def test_webhooks_wait_in_a_queue_of_their_own(settings: Settings) -> None:
    broker: Celery
    with create_queue(settings) as broker:
        assert queue.is_empty(broker)
        queue.send(broker, "1")
        assert not queue.is_empty(broker)
        assert [depth(broker, each) for each in Queue] == [0, 0, 0], "what runs jobs sees nothing of it"


def test_whoever_sends_webhooks_takes_nothing_else(settings: Settings) -> None:
    with create_sender(settings) as sender:
        assert set(sender.amqp.queues.consume_from) == {queue.QUEUE}
