"""Files dropped in a bucket of a real S3 server: told of over HTTP, watermarked, written back."""

import json
import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import timedelta
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import quote, quote_plus

import httpx2
import obstore
import psutil
import pytest
from httpx2 import Response
from obstore.store import S3Store
from sqlalchemy import select, update

from service.config import Settings
from service.jobs import contents, dropped, queue
from service.jobs.dead import retry
from service.jobs.dropped import Output
from service.jobs.ledger import WORKER_LOST, Ledger, now
from service.jobs.models import ArtifactKind, DroppedObject, Job, Priority, Queue
from tests.service.conftest import Client, client_with
from tests.service.harness import EMBEDDED_COMMAND, Service
from tests.service.s3 import KEYS, S3, Bucket, Flaky
from tests.worker.engines import asset
from tests.worker.waiting import wait_until
from worker.hook_bucket import read_object, write_object
from worker.hook_outputs import write_outputs
from worker.sweeper import sweep

TOKEN = "0123456789abcdef"


@dataclass
class Watched:
    """A bucket with a hook, and how MinIO would tell of it."""

    bucket: Bucket
    url: str  # of the server itself, also where the hook reaches it by another way
    versions: dict[str, str] = field(default_factory=dict)

    def address(self, key: str) -> str:
        return f"{self.url}/{self.bucket.name}/{quote(key)}"

    def drop(self, key: str, content: bytes) -> None:
        self.versions[key] = (obstore.put(self.store, key, content)["e_tag"] or "").strip('"')

    @property
    def store(self) -> S3Store:
        """The bucket with its owner's keys: the server lets nobody else replace an object."""
        return S3Store(
            self.bucket.name,
            endpoint=self.url,
            access_key_id=KEYS["s3_access_key_id"],
            secret_access_key=KEYS["s3_secret_access_key"],
            client_options={"allow_http": True},
        )

    def read(self, key: str) -> bytes | None:
        answer = httpx2.get(self.address(key))
        return answer.content if answer.status_code == 200 else None

    def notification(self, *keys: str, name: str = "s3:ObjectCreated:Put") -> dict[str, Any]:
        return {"EventName": name, "Records": [self.record(key, name) for key in keys]}

    def record(self, key: str, name: str) -> dict[str, Any]:
        entity = {"key": quote_plus(key), "eTag": self.versions.get(key, "0")}
        return {"eventName": name, "s3": {"bucket": {"name": self.bucket.name}, "object": entity}}

    def hooks_file(self, folder: Path, **more: str) -> Path:
        values = {
            "kind": "s3",
            "token": TOKEN,
            "bucket": self.bucket.name,
            "endpoint": self.bucket.endpoint,
            "access_key_id": KEYS["s3_access_key_id"],
            "secret_access_key": KEYS["s3_secret_access_key"],
            "input_prefix": "incoming/",
            "output_prefix": "watermarked/",
        } | more
        path = folder / "hooks.toml"
        lines = [f"{name} = {json.dumps(value)}" for name, value in values.items()]
        path.write_text("\n".join(["[sources.shop]", *lines, 'parameters = { text = "HI" }', ""]))
        return path


@pytest.fixture
def watched(s3: S3) -> Watched:
    return Watched(s3.new_bucket(), s3.url)


@pytest.fixture
def client(watched: Watched, tmp_path: Path) -> Iterator[Client]:
    with client_with(Settings(data_dir=tmp_path, hooks_file=watched.hooks_file(tmp_path))) as client:
        yield client


@pytest.fixture
def on_both(watched: Watched, database_url: str, tmp_path: Path) -> Iterator[Client]:
    """A client of the service on each database."""
    hooks = watched.hooks_file(tmp_path)
    with client_with(Settings(data_dir=tmp_path, database_url=database_url, hooks_file=hooks)) as client:
        yield client


@pytest.fixture(autouse=True)
def _without_long_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.sources.PAUSES", (0.01, 0.01))


def tell(client: Client, content: Any, source: str = "shop", token: str = TOKEN) -> Response:
    headers = {"Authorization": f"Bearer {token}"}
    return client.http.post(f"/v1/hooks/{source}", json=content, headers=headers)


def accepted(client: Client, content: Any) -> list[str]:
    """The jobs of a notification in which nothing is ignored."""
    answer = tell(client, content)
    assert answer.status_code == 202, answer.text
    assert answer.json()["ignored"] == []
    return [item["job"] for item in answer.json()["jobs"]]


def run(client: Client, job_id: str) -> dict[str, Any]:
    client.run(f"/v1/watermarks/{job_id}")
    return dict(client.http.get(f"/v1/watermarks/{job_id}").json())


def outputs(client: Client) -> list[str]:
    with client.worker.ledger.sessions() as session:
        return list(session.scalars(select(DroppedObject.output).order_by(DroppedObject.created_at)))


def claimed(ledger: Ledger, job_id: str) -> Job:
    job = ledger.claim(job_id, 60)
    assert job is not None
    return job


def make_due(client: Client) -> None:
    with client.worker.ledger.sessions.begin() as session:
        session.execute(update(DroppedObject).values(due_at=now() - timedelta(seconds=1)))


def test_a_dropped_file_is_watermarked_and_written_back(on_both: Client, watched: Watched) -> None:
    key = "incoming/a shop/my chair+é.obj"
    watched.drop(key, asset())
    [job_id] = accepted(on_both, watched.notification(key))
    assert queue.depth(on_both.worker.celery, Queue.LARGE) == 1
    write_outputs(on_both.worker)
    assert outputs(on_both) == ["pending"], "there is nothing to write yet"
    job = run(on_both, job_id)
    assert job["state"] == "succeeded"
    assert job["input"]["filename"] == "my chair+é.obj"
    assert job["metadata"] == {"hook": "shop", "key": key}
    write_outputs(on_both.worker)
    assert outputs(on_both) == ["written"]
    assert watched.read("watermarked/a shop/my chair+é.obj.watermarked.glb") == b"glTF of HI"
    report = watched.read("watermarked/a shop/my chair+é.obj.report.json")
    assert report is not None
    assert json.loads(report)["text"] == "HI"


def test_however_often_an_object_is_told_of_it_makes_one_job(on_both: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    told = watched.notification("incoming/a.obj", "incoming/a.obj")
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda _: accepted(on_both, told), range(6)))
    assert len({job_id for answer in answers for job_id in answer}) == 1
    run(on_both, answers[0][0])
    assert accepted(on_both, told)[0] == answers[0][0]
    assert len(on_both.http.get("/v1/watermarks").json()["items"]) == 1


def test_of_two_processes_that_hear_of_it_at_the_same_moment_one_makes_the_job(
    on_both: Client, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second one has looked before the first one was done, and found nothing."""
    told = watched.notification("incoming/a.obj")
    first = accepted(on_both, told)
    looks = iter([None])
    job_of = dropped.job_of
    monkeypatch.setattr(dropped, "job_of", lambda *about: next(looks, job_of(*about)))
    assert accepted(on_both, told) == first
    assert next(looks, "looked") == "looked"
    assert len(on_both.http.get("/v1/watermarks").json()["items"]) == 1


def test_new_content_under_the_same_key_is_another_job(client: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    first = accepted(client, watched.notification("incoming/a.obj"))
    watched.drop("incoming/a.obj", asset(version=2))
    assert accepted(client, watched.notification("incoming/a.obj")) != first


def test_results_of_an_older_version_do_not_replace_those_of_a_newer_one(on_both: Client, watched: Watched) -> None:
    jobs = []
    for number in range(2):
        watched.drop("incoming/a.obj", asset(version=number))
        jobs += accepted(on_both, watched.notification("incoming/a.obj"))
    with on_both.worker.ledger.sessions.begin() as session:
        session.execute(update(Job).where(Job.id == jobs[0]).values(priority=Priority.LOW))  # the newer one goes first
    for job_id in reversed(jobs):
        assert run(on_both, job_id)["state"] == "succeeded"
        write_outputs(on_both.worker)
    assert outputs(on_both) == ["superseded", "written"]


def test_what_is_not_meant_is_ignored_and_it_is_said_why(client: Client, watched: Watched) -> None:
    elsewhere = watched.notification("incoming/a.obj")
    elsewhere["Records"][0]["s3"]["bucket"]["name"] = "others"
    cases = [
        (watched.notification("incoming/a.obj", name="s3:ObjectRemoved:Delete"), "created"),
        (elsewhere, "another bucket"),
        (watched.notification("watermarked/a.obj.watermarked.glb"), "written here"),
        (watched.notification("elsewhere/a.obj"), "input prefix"),
        (watched.notification("incoming/notes.txt"), "suffixes"),
        (watched.notification("incoming/"), "suffixes"),
        (watched.notification("incoming/a\0.obj"), "name"),
        (watched.notification("incoming/" + "a" * 1024 + ".obj"), "name"),
    ]
    for content, reason in cases:
        answer = tell(client, content)
        assert (answer.status_code, answer.json()["jobs"]) == (202, []), content
        assert reason in answer.json()["ignored"][0]["reason"]
    assert tell(client, {"Event": "s3:TestEvent"}).json() == {"jobs": [], "ignored": []}
    assert client.http.get("/v1/watermarks").json()["items"] == []


def test_one_notification_may_tell_of_many(client: Client, watched: Watched) -> None:
    keys = [f"incoming/{number}.OBJ" for number in range(3)]
    for key in keys:
        watched.drop(key, asset())
    answer = tell(client, watched.notification(*keys, "incoming/notes.txt")).json()
    assert [item["key"] for item in answer["jobs"]] == keys
    assert len({item["job"] for item in answer["jobs"]}) == 3
    assert [item["key"] for item in answer["ignored"]] == ["incoming/notes.txt"]


def test_who_has_not_the_token_or_asks_for_no_hook_is_refused(client: Client, watched: Watched) -> None:
    content = watched.notification("incoming/a.obj")
    wrong = tell(client, content, token="0123456789abcdeF")
    assert (wrong.status_code, wrong.json()["code"]) == (401, "invalid_hook_token")
    assert wrong.headers["WWW-Authenticate"]
    assert client.http.post("/v1/hooks/shop", json=content).status_code == 401
    unknown = tell(client, content, source="other")
    assert (unknown.status_code, unknown.json()["code"]) == (404, "not_found")
    garbage = tell(client, {"hello": 1})
    assert (garbage.status_code, garbage.json()["code"]) == (400, "invalid_request")
    assert client.http.get("/v1/watermarks").json()["items"] == []


def test_a_service_without_hooks_has_none(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path)) as client:
        assert tell(client, {}).status_code == 404


def test_an_object_that_is_gone_fails_its_job_and_writes_nothing(client: Client, watched: Watched) -> None:
    [job_id] = accepted(client, watched.notification("incoming/never.obj"))
    job = run(client, job_id)
    assert (job["state"], job["error"]["code"]) == ("failed", "download_failed")
    write_outputs(client.worker)
    assert outputs(client) == ["none"]
    assert watched.read("watermarked/never.obj.watermarked.glb") is None


def test_an_object_over_the_limit_fails_its_job(watched: Watched, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, hooks_file=watched.hooks_file(tmp_path), max_upload_bytes=1000)
    with client_with(settings) as client:
        watched.drop("incoming/a.obj", b"v" * 1001)
        [job_id] = accepted(client, watched.notification("incoming/a.obj"))
        assert run(client, job_id)["error"]["code"] == "download_too_large"


def test_jobs_are_those_of_the_hooks_tenant(watched: Watched, tmp_path: Path) -> None:
    hooks = watched.hooks_file(tmp_path, tenant="acme")
    with client_with(Settings(data_dir=tmp_path, hooks_file=hooks, max_active_jobs=1)) as client:
        [job_id] = accepted(client, watched.notification("incoming/a.obj"))
        assert client.worker.ledger.get(job_id, "acme")
        assert client.http.get(f"/v1/watermarks/{job_id}").status_code == 404, "the default tenant's client"
        full = tell(client, watched.notification("incoming/b.obj"))
        assert (full.status_code, full.json()["code"]) == (429, "too_many_jobs")


def test_a_worker_that_died_while_it_wrote_leaves_it_to_the_next(on_both: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(on_both, watched.notification("incoming/a.obj"))
    run(on_both, job_id)
    sessions = on_both.worker.ledger.sessions
    assert [item.job_id for item in dropped.take_due(sessions)] == [job_id]  # and then it dies
    assert dropped.take_due(sessions) == [], "nobody else is at it meanwhile"
    write_outputs(on_both.worker)
    assert outputs(on_both) == ["pending"]
    make_due(on_both)
    write_outputs(on_both.worker)
    assert outputs(on_both) == ["written"]
    assert watched.read("watermarked/a.obj.watermarked.glb") == b"glTF of HI"


def dead(client: Client, job_id: str) -> None:
    """Let the job's worker die too often."""
    ledger = client.worker.ledger
    assert ledger.claim(job_id, 0.001)
    time.sleep(0.01)
    assert ledger.recover(1, WORKER_LOST) == ([], [job_id])


@pytest.mark.parametrize("brought", [False, True])
def test_the_results_of_a_dead_job_that_is_tried_again_are_written_back(
    brought: bool, on_both: Client, watched: Watched
) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(on_both, watched.notification("incoming/a.obj"))
    ledger, store = on_both.worker.ledger, on_both.artifacts
    if brought:
        with store.stage(BytesIO(asset()), limit=10_000, name="file") as staged:
            lease = claimed(ledger, job_id).lease
            assert contents.publish(ledger, store, lease, ArtifactKind.INPUT, staged)
            assert ledger.release(lease)
    dead(on_both, job_id)
    write_outputs(on_both.worker)
    assert outputs(on_both) == ["none"]
    again = retry(ledger, store, job_id)
    assert accepted(on_both, watched.notification("incoming/a.obj")) == [again.id]
    assert run(on_both, again.id)["state"] == "succeeded"
    write_outputs(on_both.worker)
    assert outputs(on_both) == ["written"]
    assert watched.read("watermarked/a.obj.watermarked.glb") == b"glTF of HI"


def test_a_dead_job_that_is_tried_again_while_a_worker_looks_at_it_is_not_taken_for_done(
    on_both: Client, watched: Watched
) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(on_both, watched.notification("incoming/a.obj"))
    dead(on_both, job_id)
    sessions = on_both.worker.ledger.sessions
    [item] = dropped.take_due(sessions)
    again = retry(on_both.worker.ledger, on_both.artifacts, job_id)
    dropped.settle(sessions, item, Output.NONE)
    assert run(on_both, again.id)["state"] == "succeeded"
    write_outputs(on_both.worker)
    assert outputs(on_both) == ["written"]


def test_results_that_were_deleted_are_not_written(client: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(client, watched.notification("incoming/a.obj"))
    run(client, job_id)
    client.http.delete(f"/v1/watermarks/{job_id}")
    write_outputs(client.worker)
    assert outputs(client) == [Output.NONE]


def test_a_bucket_that_fails_for_a_while_delays_reading_and_writing(
    s3: S3, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("worker.tasks.PATIENCE", 0.1)
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
            write_outputs(client.worker)
            assert flaky.failed
            assert outputs(client) == ["pending"]
            flaky.failing.clear()
            make_due(client)
            write_outputs(client.worker)
            assert outputs(client) == ["written"]
            flaky.failing.set()
            watched.drop("incoming/b.obj", asset())
            [job_id] = accepted(client, watched.notification("incoming/b.obj"))
            assert (run(client, job_id)["state"], run(client, job_id)["attempts"]) == ("queued", 0)
            flaky.failing.clear()
            assert run(client, job_id)["state"] == "succeeded"


def test_results_are_kept_until_a_bucket_that_refuses_them_takes_them(
    client: Client, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The server answers 403 to whoever has no keys and wants what is not public, or to replace an object."""
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(client, watched.notification("incoming/a.obj"))
    assert run(client, job_id)["state"] == "succeeded"
    for name in ("watermarked/a.obj.report.json", "watermarked/a.obj.watermarked.glb"):
        watched.drop(name, b"not to be replaced without keys")
    hook = client.worker.settings.hooks["shop"]
    open_bucket = S3Store(hook.bucket, endpoint=hook.endpoint, skip_signature=True, client_options={"allow_http": True})
    with monkeypatch.context() as without_keys:
        without_keys.setattr("worker.hook_bucket.open_bucket", lambda _: open_bucket)
        write_outputs(client.worker)
    assert outputs(client) == ["pending"]
    make_due(client)
    write_outputs(client.worker)
    assert outputs(client) == ["written"]


def test_large_results_arrive_whole(client: Client) -> None:
    hook = client.worker.settings.hooks["shop"]
    content = os.urandom(12 * 2**20)
    write_object(hook, "watermarked/large", iter([content[:100], content[100:]]), "model/gltf-binary")
    target = BytesIO()
    read_object(hook, "watermarked/large", target, len(content), lambda: None)
    assert target.getvalue() == content


def test_the_sweeper_leaves_waiting_objects_alone(client: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(client, watched.notification("incoming/a.obj"))
    sweep(client.worker)
    assert run(client, job_id)["state"] == "succeeded"


def test_with_real_processes_a_dropped_file_comes_back_by_itself(watched: Watched, tmp_path: Path) -> None:
    """As CloudEvents this time; the worker is killed on the way, and another one brings it to its end."""
    hooks = watched.hooks_file(tmp_path, kind="cloudevents")
    service = Service(tmp_path, hooks_file=os.fspath(hooks))
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
        wait_until(lambda: watched.read("watermarked/a.obj.watermarked.glb"), 30)
        assert watched.read("watermarked/a.obj.watermarked.glb") == b"glTF of HI"
        assert watched.read("watermarked/a.obj.report.json")
        assert service.job(url)["attempts"] == 2
