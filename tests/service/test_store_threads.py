"""A store that hangs holds up what waits for it, with a bound, and nothing else."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import anyio
import pytest
from anyio.to_thread import current_default_thread_limiter

from core.errors import MeshmarkError
from service import store_threads
from service.store_threads import StoreThreads
from tests.service.harness import API_COMMAND, WORKER_COMMAND, Service, redis_server, running
from tests.service.postgres import Postgres
from tests.service.s3 import S3

EACH = 20  # requests of each kind: together more than an API has threads, and more than it has connections


def test_who_finds_no_free_thread_in_time_is_sent_away_and_others_have_theirs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_threads, "TIMEOUT", 0.05)
    over = threading.Event()

    async def main() -> None:
        threads = StoreThreads(2)
        async with anyio.create_task_group() as group:
            for _ in range(2):
                group.start_soon(threads.run, over.wait)
            await anyio.wait_all_tasks_blocked()
            assert current_default_thread_limiter().borrowed_tokens == 0
            with pytest.raises(MeshmarkError) as refused:
                await threads.run(over.wait)
            assert refused.value.code == "service_unavailable"
            over.set()
        assert await threads.run(over.is_set)
        assert [chunk async for chunk in threads.each(iter([b"a", b"b"]))] == [b"a", b"b"]

    anyio.run(main)


def test_while_the_store_hangs_jobs_are_answered_and_what_needs_it_is_told_to_come_again_or_done(
    s3: S3, postgres: Postgres, tmp_path: Path
) -> None:
    with ExitStack() as stack:
        service = Service(
            tmp_path,
            broker_url=stack.enter_context(redis_server(tmp_path)),
            database_url=postgres.new_database(),
            **s3.new_bucket().settings,
        )
        stack.enter_context(service.running(API_COMMAND))
        done = service.start_job()
        with running(WORKER_COMMAND, service.environment):
            service.wait_for(done, "succeeded")
        upload = service.client.post("/v1/uploads", json={"size": 1}).json()["url"]
        needs = [partial(service.client.delete, service.start_job(number=number)) for number in range(EACH)]
        needs += EACH * [partial(service.client.get, f"{done}/model")]
        needs += EACH * [partial(service.client.put, upload, content=b"v")]
        with ThreadPoolExecutor(len(needs)) as clients, s3.hanging():
            waiting = [*map(clients.submit, needs)]
            time.sleep(2)  # they arrive
            for url in ("/healthz", done, "/v1/watermarks"):
                assert service.client.get(url).status_code == 200
            assert not any(request.done() for request in waiting)
            s3.wake()
            answers = [request.result() for request in waiting]
        assert {answer.status_code for answer in answers} <= {200, 204, 503}
        assert all(int(answer.headers["Retry-After"]) > 0 for answer in answers if answer.status_code == 503)
        assert service.client.get(f"{done}/model").content == b"glTF of HI"
