"""Results of dropped files are written back to their bucket on a real S3 server."""

import json
import os
import threading
from contextlib import closing
from functools import partial
from io import BytesIO
from pathlib import Path

import psutil
import pytest
from obstore.store import S3Store
from sqlalchemy import update

from service.config import Settings
from service.jobs import dropped, queue
from service.jobs.contents import create_job
from service.jobs.dropped import Output
from service.jobs.ledger import Submission
from service.jobs.models import ArtifactKind, Job, Priority, Queue
from tests.service.conftest import Client, client_with
from tests.service.harness import EMBEDDED_COMMAND, Service
from tests.service.s3 import S3, Bucket, Flaky
from tests.service.silent import SilentServer
from tests.service.watched import TOKEN, Watched, accepted, make_due, outputs, run
from tests.worker.engines import asset
from tests.worker.waiting import wait_until
from worker.hook_outputs import start_writer, write_outputs


def test_a_dropped_file_is_watermarked_and_written_back(hooked_on_both: Client, watched: Watched) -> None:
    key = "incoming/a shop/my chair+é.obj"
    watched.drop(key, asset())
    [job_id] = accepted(hooked_on_both, watched.notification(key))
    assert queue.depth(hooked_on_both.worker.celery, Queue.LARGE) == 1
    write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["pending"], "there is nothing to write yet"
    job = run(hooked_on_both, job_id)
    assert job["state"] == "succeeded"
    assert job["input"]["filename"] == "my chair+é.obj"
    assert job["metadata"] == {"hook": "shop", "key": key}
    write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["written"]
    assert watched.read("watermarked/a shop/my chair+é.obj.watermarked.glb") == b"glTF of HI"
    assert watched.read("watermarked/a shop/my chair+é.obj.watermarked.preview.glb") == b"glTF in little"
    assert watched.read("watermarked/a shop/my chair+é.obj.watermarked.ply") == b"ply\n"
    report = watched.read("watermarked/a shop/my chair+é.obj.report.json")
    assert report is not None
    assert json.loads(report)["text"] == "HI"


def test_results_of_an_older_version_do_not_replace_those_of_a_newer_one(
    hooked_on_both: Client, watched: Watched
) -> None:
    jobs = []
    for number in range(2):
        watched.drop("incoming/a.obj", asset(version=number))
        jobs += accepted(hooked_on_both, watched.notification("incoming/a.obj"))
    with hooked_on_both.worker.ledger.sessions.begin() as session:
        session.execute(update(Job).where(Job.id == jobs[0]).values(priority=Priority.LOW))  # the newer one goes first
    for job_id in reversed(jobs):
        assert run(hooked_on_both, job_id)["state"] == "succeeded"
        write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["superseded", "written"]


def test_what_a_slow_worker_wrote_over_a_newer_version_is_replaced_again(
    hooked_on_both: Client, watched: Watched
) -> None:
    name, sessions = "watermarked/a.obj.watermarked.glb", hooked_on_both.worker.ledger.sessions
    watched.drop("incoming/a.obj", asset(version=1))
    run(hooked_on_both, *accepted(hooked_on_both, watched.notification("incoming/a.obj")))
    slow = dropped.take_due(sessions, "shop")
    assert slow is not None
    watched.drop("incoming/a.obj", asset(version=2))
    run(hooked_on_both, *accepted(hooked_on_both, watched.notification("incoming/a.obj")))
    write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["pending", "written"]
    watched.drop(name, b"results of the first version")
    dropped.settle(sessions, slow, Output.WRITTEN)
    assert outputs(hooked_on_both) == ["written", "pending"]
    write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["written", "written"]
    assert watched.read(name) == b"glTF of HI"


def test_a_bucket_that_does_not_answer_delays_no_other_one(watched: Watched, tmp_path: Path) -> None:
    server, hooks = SilentServer(), watched.hooks_file(tmp_path)
    silent = Watched(Bucket(f"http://{server.address}", "silent"), watched.url)
    (tmp_path / "silent").mkdir()
    both = hooks.read_text() + silent.hooks_file(tmp_path / "silent").read_text().replace("shop", "silent")
    hooks.write_text(both)
    with client_with(Settings(data_dir=tmp_path, hooks_file=hooks)) as client:
        with closing(server):
            for source in ("silent", "shop"):
                run_as_if_dropped(client, source)
            start_writer(client.worker)
            wait_until(lambda: watched.read("watermarked/a.obj.watermarked.glb"))
            client.worker.stop()
        wait_until(lambda: not any("hook-outputs" in thread.name for thread in threading.enumerate()))


def run_as_if_dropped(client: Client, source: str) -> None:
    """A job of an object of a hook, whose asset is there already."""
    store = client.artifacts
    with store.stage(BytesIO(asset(source=source)), limit=1000, name="file") as staged:
        record = partial(dropped.record, object_id=source, source=source, key="incoming/a.obj")
        parts, submission = {ArtifactKind.INPUT: staged}, Submission(condition=record)
        job = create_job(client.worker.ledger, store, "a.obj", {"text": "HI"}, parts, submission)
    client.worker.run(job.id)


def test_a_worker_that_died_while_it_wrote_leaves_it_to_the_next(hooked_on_both: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(hooked_on_both, watched.notification("incoming/a.obj"))
    run(hooked_on_both, job_id)
    sessions = hooked_on_both.worker.ledger.sessions
    taken = dropped.take_due(sessions, "shop")
    assert taken is not None
    assert taken.job_id == job_id  # and then it dies
    assert dropped.take_due(sessions, "shop") is None, "nobody else is at it meanwhile"
    write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["pending"]
    make_due(hooked_on_both)
    write_outputs(hooked_on_both.worker, "shop")
    assert outputs(hooked_on_both) == ["written"]
    assert watched.read("watermarked/a.obj.watermarked.glb") == b"glTF of HI"


def test_results_that_were_deleted_are_not_written(hooked: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(hooked, watched.notification("incoming/a.obj"))
    run(hooked, job_id)
    hooked.http.delete(f"/v1/watermarks/{job_id}")
    write_outputs(hooked.worker, "shop")
    assert outputs(hooked) == [Output.NONE]


def test_results_are_kept_until_a_bucket_that_refuses_them_takes_them(
    hooked: Client, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The server answers 403 to whoever has no keys and wants what is not public, or to replace an object."""
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(hooked, watched.notification("incoming/a.obj"))
    assert run(hooked, job_id)["state"] == "succeeded"
    for name in ("watermarked/a.obj.report.json", "watermarked/a.obj.watermarked.glb"):
        watched.drop(name, b"not to be replaced without keys")
    hook = hooked.worker.settings.hooks["shop"]
    open_bucket = S3Store(hook.bucket, endpoint=hook.endpoint, skip_signature=True, client_options={"allow_http": True})
    with monkeypatch.context() as without_keys:
        without_keys.setattr("worker.hook_bucket.open_bucket", lambda _: open_bucket)
        write_outputs(hooked.worker, "shop")
    assert outputs(hooked) == ["pending"]
    make_due(hooked)
    write_outputs(hooked.worker, "shop")
    assert outputs(hooked) == ["written"]


def test_a_bucket_that_fails_for_a_while_delays_reading_and_writing(
    s3: S3, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("worker.tasks.RETRY_SECONDS", 0.1)
    with Flaky(s3.url).running() as flaky:
        bucket = s3.new_bucket()
        bucket.endpoint = flaky.url
        watched = Watched(bucket, s3.url)
        settings = Settings(data_dir=tmp_path, hooks_file=watched.hooks_file(tmp_path), lease_seconds=60)
        with client_with(settings) as client:
            watched.drop("incoming/a.obj", asset())
            [job_id] = accepted(client, watched.notification("incoming/a.obj"))
            assert run(client, job_id)["state"] == "succeeded"
            flaky.failing.set()
            write_outputs(client.worker, "shop")
            assert flaky.failed
            assert outputs(client) == ["pending"]
            flaky.failing.clear()
            make_due(client)
            write_outputs(client.worker, "shop")
            assert outputs(client) == ["written"]
            flaky.failing.set()
            watched.drop("incoming/b.obj", asset())
            [job_id] = accepted(client, watched.notification("incoming/b.obj"))
            assert (run(client, job_id)["state"], run(client, job_id)["attempts"]) == ("queued", 0)
            flaky.failing.clear()
            assert run(client, job_id)["state"] == "succeeded"


def test_with_real_processes_a_dropped_file_comes_back_by_itself(watched: Watched, tmp_path: Path) -> None:
    """As CloudEvents this time, with the artifacts in the same bucket; the worker is killed on the way, and another one
    brings it to its end."""
    hooks = watched.hooks_file(tmp_path, kind="cloudevents")
    service = Service(tmp_path, hooks_file=os.fspath(hooks), **watched.bucket.settings)
    go = tmp_path / "go"
    with service.running(EMBEDDED_COMMAND) as [process]:
        watched.drop("incoming/a.obj", asset(wait_for=os.fspath(go)))
        event = {
            "specversion": "1.0",
            "id": "1",
            "source": "aws:s3",
            "type": "com.amazonaws.s3.ObjectCreated:Put",
            "data": watched.record("incoming/a.obj", "ObjectCreated:Put"),
        }
        headers = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/cloudevents+json"}
        answers = [service.client.post("/v1/hooks/shop", content=json.dumps(event), headers=headers) for _ in range(2)]
        assert [answer.status_code for answer in answers] == [202, 202]
        assert answers[0].json() == answers[1].json()
        [item] = answers[0].json()["jobs"]
        url = f"/v1/watermarks/{item['job']}"
        wait_until(lambda: service.job(url)["stage"] == "placing")
        for child in psutil.Process(process.pid).children():
            if "tests.worker.apps" in child.cmdline():
                child.kill()
        go.touch()
        wait_until(lambda: watched.read("watermarked/a.obj.watermarked.glb"))
        assert watched.read("watermarked/a.obj.watermarked.glb") == b"glTF of HI"
        assert watched.read("watermarked/a.obj.report.json")
        assert service.job(url)["attempts"] == 2
