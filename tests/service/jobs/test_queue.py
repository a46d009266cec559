from pathlib import Path

from service.config import Settings
from service.jobs import queue


def test_what_is_sent_to_the_file_broker_waits_there(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    app = queue.create_queue(settings)
    assert queue.depth(app) == 0
    queue.send(app, "first")
    queue.send(app, "second")
    assert queue.depth(app) == 2
    assert queue.depth(queue.create_queue(settings)) == 2  # as another process sees it


def test_a_message_half_written_is_not_seen(tmp_path: Path) -> None:
    app = queue.create_queue(Settings(data_dir=tmp_path))
    queue.send(app, "whole")
    (tmp_path / "broker" / "messages" / ".half.draft").write_text('{"body": ')
    assert queue.depth(app) == 1


def test_redis_hands_a_message_out_again_only_when_no_job_can_still_run() -> None:
    app = queue.create_queue(Settings(broker_url="redis://localhost", job_time_limit=100))
    assert app.conf.broker_transport_options["visibility_timeout"] > 100
    assert app.conf.broker_transport is None
