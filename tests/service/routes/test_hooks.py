"""Files dropped in a bucket of a real S3 server are told of over HTTP."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from service.config import Settings
from service.hooks.events import parse_notification
from service.jobs import dropped
from service.routes import hooks
from tests.service.conftest import Client, client_with
from tests.service.watched import Watched, accepted, run, tell
from tests.worker.engines import asset


def test_however_often_an_object_is_told_of_it_makes_one_job(hooked_on_both: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    told = watched.notification("incoming/a.obj", "incoming/a.obj")
    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(lambda _: accepted(hooked_on_both, told), range(6)))
    assert len({job_id for answer in answers for job_id in answer}) == 1
    run(hooked_on_both, answers[0][0])
    assert accepted(hooked_on_both, told)[0] == answers[0][0]
    assert len(hooked_on_both.http.get("/v1/watermarks").json()["items"]) == 1


def test_of_two_processes_that_hear_of_it_at_the_same_moment_one_makes_the_job(
    hooked_on_both: Client, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second one has looked before the first one was done, and found nothing."""
    told = watched.notification("incoming/a.obj")
    first = accepted(hooked_on_both, told)
    looks = iter([None])
    job_of = dropped.job_of
    monkeypatch.setattr(dropped, "job_of", lambda *about: next(looks, job_of(*about)))
    assert accepted(hooked_on_both, told) == first
    assert next(looks, "looked") == "looked"
    assert len(hooked_on_both.http.get("/v1/watermarks").json()["items"]) == 1


def test_new_content_under_the_same_key_is_another_job(hooked: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    first = accepted(hooked, watched.notification("incoming/a.obj"))
    watched.drop("incoming/a.obj", asset(version=2))
    assert accepted(hooked, watched.notification("incoming/a.obj")) != first


def test_what_is_not_meant_is_ignored_and_it_is_said_why(hooked: Client, watched: Watched) -> None:
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
        answer = tell(hooked, content)
        assert (answer.status_code, answer.json()["jobs"]) == (202, []), content
        assert reason in answer.json()["ignored"][0]["reason"]
    assert tell(hooked, {"Event": "s3:TestEvent"}).json() == {"jobs": [], "ignored": []}
    assert hooked.http.get("/v1/watermarks").json()["items"] == []


def test_one_notification_may_tell_of_many(hooked: Client, watched: Watched) -> None:
    keys = [f"incoming/{number}.OBJ" for number in range(3)]
    for key in keys:
        watched.drop(key, asset())
    answer = tell(hooked, watched.notification(*keys, "incoming/notes.txt")).json()
    assert [item["key"] for item in answer["jobs"]] == keys
    assert len({item["job"] for item in answer["jobs"]}) == 3
    assert [item["key"] for item in answer["ignored"]] == ["incoming/notes.txt"]


def test_a_notification_is_not_read_in_the_loop(
    hooked: Client, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_loop = []

    def parse(*given: Any) -> Any:
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            in_loop.append(False)
        else:
            in_loop.append(True)
        return parse_notification(*given)

    monkeypatch.setattr(hooks, "parse_notification", parse)
    assert len(accepted(hooked, watched.notification("incoming/a.obj"))) == 1
    assert in_loop == [False]


def test_who_has_not_the_token_or_asks_for_no_hook_is_refused(hooked: Client, watched: Watched) -> None:
    content = watched.notification("incoming/a.obj")
    wrong = tell(hooked, content, token="0123456789abcdeF")
    assert (wrong.status_code, wrong.json()["code"]) == (401, "invalid_hook_token")
    assert wrong.headers["WWW-Authenticate"]
    assert hooked.http.post("/v1/hooks/shop", json=content).status_code == 401
    unknown = tell(hooked, content, source="other")
    assert (unknown.status_code, unknown.json()["code"]) == (404, "not_found")
    garbage = tell(hooked, {"hello": 1})
    assert (garbage.status_code, garbage.json()["code"]) == (400, "invalid_request")
    assert hooked.http.get("/v1/watermarks").json()["items"] == []


def test_a_service_without_hooks_has_none(tmp_path: Path) -> None:
    with client_with(Settings(data_dir=tmp_path)) as client:
        assert tell(client, {}).status_code == 404


def test_jobs_are_those_of_the_hooks_tenant(watched: Watched, tmp_path: Path) -> None:
    hooks = watched.hooks_file(tmp_path, tenant="acme")
    with client_with(Settings(data_dir=tmp_path, hooks_file=hooks, max_active_jobs=1)) as client:
        [job_id] = accepted(client, watched.notification("incoming/a.obj"))
        assert client.worker.ledger.get(job_id, "acme")
        assert client.http.get(f"/v1/watermarks/{job_id}").status_code == 404, "the default tenant's client"
        full = tell(client, watched.notification("incoming/b.obj"))
        assert (full.status_code, full.json()["code"]) == (429, "too_many_jobs")
