"""A worker reads what was dropped in a bucket of a real S3 server."""

import os
from io import BytesIO
from pathlib import Path

import pytest

from service.config import Settings
from tests.service.conftest import Client, client_with
from tests.service.watched import Watched, accepted, outputs, run
from tests.worker.engines import asset
from worker.hook_bucket import read_object, write_object
from worker.hook_outputs import write_outputs
from worker.sweeper import sweep


@pytest.fixture(autouse=True)
def _without_long_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.sources.PAUSES", (0.01, 0.01))


def test_an_object_that_is_gone_fails_its_job_and_writes_nothing(hooked: Client, watched: Watched) -> None:
    [job_id] = accepted(hooked, watched.notification("incoming/never.obj"))
    job = run(hooked, job_id)
    assert (job["state"], job["error"]["code"]) == ("failed", "download_failed")
    write_outputs(hooked.worker, "shop")
    assert outputs(hooked) == ["none"]
    assert watched.read("watermarked/never.obj.watermarked.glb") is None


def test_an_object_over_the_limit_fails_its_job(watched: Watched, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, hooks_file=watched.hooks_file(tmp_path), max_upload_bytes=1000)
    with client_with(settings) as client:
        watched.drop("incoming/a.obj", b"v" * 1001)
        [job_id] = accepted(client, watched.notification("incoming/a.obj"))
        assert run(client, job_id)["error"]["code"] == "download_too_large"


def test_large_results_arrive_whole(hooked: Client, tmp_path: Path) -> None:
    hook, result = hooked.worker.settings.hooks["shop"], tmp_path / "result"
    content = os.urandom(12 * 2**20)
    result.write_bytes(content)
    write_object(hook, "watermarked/large", result, "model/gltf-binary")
    target = BytesIO()
    read_object(hook, "watermarked/large", target, len(content), lambda: None)
    assert target.getvalue() == content


def test_the_sweeper_leaves_waiting_objects_alone(hooked: Client, watched: Watched) -> None:
    watched.drop("incoming/a.obj", asset())
    [job_id] = accepted(hooked, watched.notification("incoming/a.obj"))
    sweep(hooked.worker)
    assert run(hooked, job_id)["state"] == "succeeded"
