from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import anyio
import pytest

from service import announcer
from service.announcer import Announcer
from service.config import Settings
from service.jobs.models import Job, JobState, Queue
from service.jobs.queue import create_queue, depth
from tests.service.harness import API_COMMAND, Service
from tests.service.silent import SilentServer
from tests.worker.engines import asset

REQUESTS = 50  # more than there are threads for answering


def test_while_the_broker_says_nothing_all_requests_are_answered(tmp_path: Path) -> None:
    server = SilentServer()
    service = Service(tmp_path, broker_url=f"redis://{server.address}/0", max_uploads_at_once=str(REQUESTS))
    with service.running(API_COMMAND), closing(server), ThreadPoolExecutor(REQUESTS) as pool:
        accepted = [pool.submit(service.submit, asset(number=number)) for number in range(REQUESTS)]
        assert {answer.result().status_code for answer in accepted} == {202}
        assert len(service.client.get("/v1/watermarks?limit=100").json()["items"]) == REQUESTS
        assert server.left() == 0, "nobody has waited until the broker was given up"


def test_of_too_many_jobs_some_are_left_to_the_sweeper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(announcer, "MOST", 3)
    broker = create_queue(Settings(data_dir=tmp_path))
    job = Job(id="a job", queue=Queue.SMALL, state=JobState.QUEUED)

    async def announce_many() -> None:
        several = Announcer(broker)
        async with anyio.create_task_group() as group:
            for _ in range(100):
                group.start_soon(several.announce, job)
        assert depth(broker, Queue.SMALL) == 3
        await several.announce(job)
        assert depth(broker, Queue.SMALL) == 4

    anyio.run(announce_many)
    broker.close()


def test_a_job_that_has_ended_is_not_announced(tmp_path: Path) -> None:
    broker = create_queue(Settings(data_dir=tmp_path))
    anyio.run(Announcer(broker).announce, Job(id="a job", queue=Queue.SMALL, state=JobState.SUCCEEDED))
    assert depth(broker, Queue.SMALL) == 0
    broker.close()
