from pathlib import Path

from service.config import Settings
from service.jobs import queue
from service.jobs.models import Queue


def test_what_is_sent_to_the_file_broker_waits_there(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    app = queue.create_queue(settings)
    assert queue.depth(app, Queue.SMALL) == 0
    queue.send(app, "first", Queue.SMALL)
    queue.send(app, "second", Queue.SMALL)
    assert queue.depth(app, Queue.SMALL) == 2
    assert queue.depth(queue.create_queue(settings), Queue.SMALL) == 2  # as another process sees it


def test_a_message_half_written_is_not_seen(tmp_path: Path) -> None:
    app = queue.create_queue(Settings(data_dir=tmp_path))
    queue.send(app, "whole", Queue.SMALL)
    (tmp_path / "broker" / "messages" / ".half.draft").write_text('{"body": ')
    assert queue.depth(app, Queue.SMALL) == 1


def test_redis_hands_a_message_out_again_only_when_no_job_can_still_run() -> None:
    app = queue.create_queue(Settings(broker_url="redis://localhost", job_time_limit=100))
    assert app.conf.broker_transport_options["visibility_timeout"] > 100
    assert app.conf.broker_transport is None


def test_assets_wait_by_their_size_and_for_a_gpu_only_where_there_is_one() -> None:
    settings = Settings(large_asset_bytes=100)
    assert [queue.queue_for(settings, size) for size in (99, 100, 10**9)] == [Queue.SMALL, Queue.LARGE, Queue.LARGE]
    settings = Settings(large_asset_bytes=100, gpu_asset_bytes=1000)
    assert [queue.queue_for(settings, size) for size in (99, 999, 1000)] == [Queue.SMALL, Queue.LARGE, Queue.GPU]


def test_each_queue_has_messages_of_its_own(tmp_path: Path) -> None:
    app = queue.create_queue(Settings(data_dir=tmp_path))
    for _ in range(2):
        queue.send(app, "job", Queue.LARGE)
    assert [queue.depth(app, each) for each in Queue] == [0, 2, 0]
