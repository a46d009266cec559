"""`python -m service`: API and worker together, with nothing beside them."""

import json
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import jsonschema
import psutil
import pytest

from tests.service.harness import API_COMMAND, EMBEDDED_COMMAND, HEEDING, Service
from tests.worker.waiting import PATIENCE, gone, wait_until

SPOT = (Path(__file__).parents[1] / "data" / "spot.glb").read_bytes()
CUBE = b"""
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("embedded"), worker_concurrency="2", job_time_limit="20")
    with service.running(EMBEDDED_COMMAND):
        yield service


def test_an_asset_goes_in_and_model_report_and_preview_come_out(service: Service) -> None:
    url = service.start_job()
    job = service.wait_for(url, "succeeded")
    assert (job["progress"], job["stage"], job["attempts"], job["error"]) == (1, None, 1, None)
    assert service.client.get(job["links"]["model"]).content == b"glTF of HI"
    assert service.client.get(job["links"]["report"]).json() == {
        "text": "HI",
        "font": False,
        "logo": False,
        "metrics": {"ocr": 1.0, "missing": {}},
    }
    assert service.client.get(job["links"]["preview"]).content == b"\x89PNG"


def test_the_model_can_be_fetched_while_the_metrics_are_still_computed(service: Service, tmp_path: Path) -> None:
    go = tmp_path / "go"
    url = service.start_job(wait_for_before_the_report=os.fspath(go))
    wait_until(lambda: service.job(url)["stage"] == "evaluating")
    job = service.job(url)
    assert job["state"] == "running"
    assert job["links"]["model"]
    assert job["links"]["report"] is None
    assert service.client.get(f"{url}/model").content == b"glTF of HI"
    assert service.client.get(f"{url}/report").json()["code"] == "not_ready"
    go.touch()
    service.wait_for(url, "succeeded")


def test_a_crash_of_the_engine_ends_that_job_and_nothing_else(service: Service) -> None:
    broken, sound = service.start_job("segfault"), service.start_job()
    error = service.wait_for(broken, "failed")["error"]
    assert error["code"] == "engine_crashed"
    assert error["remedy"]
    assert service.client.get(f"{broken}/model").json()["code"] == "job_failed"
    service.wait_for(sound, "succeeded")


def test_a_running_job_that_is_deleted_is_stopped_and_leaves_no_file(service: Service) -> None:
    url = service.start_job("hang")
    scratch = Path(service.environment["MESHMARK_DATA_DIR"], "scratch")
    wait_until(lambda: any(path.read_text() for path in scratch.glob("*/pid")))
    engine = psutil.Process(int(next(scratch.glob("*/pid")).read_text()))
    digest = service.job(url)["input"]["sha256"]
    stored = Path(service.environment["MESHMARK_DATA_DIR"]) / "artifacts" / digest[:2] / digest
    assert stored.exists()
    assert service.client.delete(url).status_code == 204
    assert service.job(url)["state"] == "canceled"
    assert service.client.get(f"{url}/model").json()["code"] == "job_canceled"
    assert not stored.exists()
    wait_until(lambda: gone(engine))
    assert service.client.delete(url).status_code == 204


def test_a_job_survives_the_death_of_its_worker(service: Service) -> None:
    [worker] = [each for each in psutil.Process().children(recursive=True) if "tests.worker.apps" in each.cmdline()]
    url = service.start_job("kill_worker", pid=worker.pid)
    assert service.wait_for(url, "succeeded")["attempts"] == 2


def test_a_job_whose_workers_keep_dying_fails_as_worker_lost(service: Service) -> None:
    job = service.wait_for(service.start_job("kill_worker"), "failed")
    assert (job["error"]["code"], job["attempts"]) == ("worker_lost", 2)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])  # the second as a terminal that closes
def test_stopping_ends_api_worker_and_engine_and_the_job_goes_on_at_the_next_start(
    number: signal.Signals, tmp_path: Path
) -> None:
    service, go = Service(tmp_path), tmp_path / "go"
    with service.running([*HEEDING, *EMBEDDED_COMMAND]) as [process]:
        url = service.start_job(wait_for=os.fspath(go))
        wait_until(lambda: service.job(url)["stage"] == "placing")
        family = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(number)
        assert process.wait(PATIENCE) == 0
    assert len(family) == 4  # the worker, its template, the engine's process, and the template of the gate
    assert all(map(gone, family))
    go.touch()
    with service.running(EMBEDDED_COMMAND):
        assert service.wait_for(url, "succeeded")["attempts"] == 1


def test_the_worker_ends_with_a_service_that_is_killed(tmp_path: Path) -> None:
    service = Service(tmp_path)
    with service.running(EMBEDDED_COMMAND) as [process]:
        url = service.start_job("hang")
        wait_until(lambda: service.job(url)["stage"] == "placing")
        family = psutil.Process(process.pid).children(recursive=True)
        process.kill()
        process.wait()
        wait_until(lambda: all(map(gone, family)))


def test_one_command_starts_the_real_engine_and_a_solid_comes_back_watermarked(tmp_path: Path) -> None:
    service = Service(tmp_path, lease_seconds="15")
    with service.running([sys.executable, "-m", "service"]) as [process]:
        response = service.submit(CUBE, params='{"text": "HI", "count": 6, "evaluate": "none"}')
        assert response.status_code == 202, response.text
        job = service.wait_for(response.headers["Location"], "succeeded")
        assert service.client.get(job["links"]["model"]).content[:4] == b"glTF"
        report = service.client.get(job["links"]["report"]).json()
        document = service.client.get("/openapi.json").json()
        described = {"$ref": "#/components/schemas/Report", "components": document["components"]}
        jsonschema.Draft202012Validator(described).validate(report)
        assert report["schema"] == "meshmark.report/1"
        assert {mark["text"] for mark in report["watermarks"]} == {"HI"}
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0


def test_a_worker_killed_in_the_middle_of_the_real_engine_loses_no_job(tmp_path: Path) -> None:
    service = Service(tmp_path, max_attempts="2")
    with service.running([sys.executable, "-m", "service"]) as [process]:
        url = service.submit(SPOT, params='{"text": "watermark", "count": 4}').headers["Location"]
        wait_until(lambda: service.job(url)["stage"] in ("placing", "embossing"))
        [worker] = [child for child in psutil.Process(process.pid).children() if "worker" in child.cmdline()]
        [template] = worker.children()
        [engine] = template.children()
        worker.kill()
        job = service.wait_for(url, "succeeded")
        assert gone(template)
        assert gone(engine)
        assert (job["attempts"], job["error"]) == (2, None)
        assert service.client.get(job["links"]["model"]).content[:4] == b"glTF"
        assert len(service.client.get(job["links"]["report"]).json()["watermarks"]) == 4


def test_the_budgets_that_are_set_hold_at_the_gate_and_in_the_job(tmp_path: Path) -> None:
    polygon = (
        CUBE + b"f " + b" ".join(b"%d" % (1 + k % 8) for k in range(40)) + b"\n"
    )  # 38 triangles, which no line counts
    service = Service(tmp_path, max_faces="20")
    with service.running([sys.executable, "-m", "service"]):
        lines = service.submit(CUBE + b"f 1 2 3\n" * 21).json()
        assert (lines["code"], "at most 20 are accepted" in lines["detail"]) == ("budget_exceeded", True)
        job = service.wait_for(service.submit(polygon).headers["Location"], "failed")
        assert job["error"]["code"] == "budget_exceeded"


def test_the_service_writes_log_lines_and_nothing_else(tmp_path: Path) -> None:
    script = f"exec {sys.executable} -m service >{tmp_path}/out 2>{tmp_path}/err"
    service = Service(tmp_path)
    with service.running(["sh", "-c", script]):
        service.wait_for(service.submit(CUBE + b"f 1 2 99\n").headers["Location"], "failed")
    assert (tmp_path / "out").read_text() == ""
    lines = [json.loads(line) for line in (tmp_path / "err").read_text().splitlines()]
    assert "job failed" in [line["event"] for line in lines]


def test_an_upload_far_over_the_limit_gets_its_answer_while_it_is_still_sent(tmp_path: Path) -> None:
    service = Service(tmp_path, max_upload_bytes="1000000", max_font_bytes="1")
    sent = 0

    def parts() -> Iterator[bytes]:
        nonlocal sent
        yield b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.obj"\r\n\r\n'
        for _ in range(500):
            sent += 1
            yield b"v" * 2**20

    with service.running(API_COMMAND) as [process]:
        declared = service.submit(b"v" * 2**26)
        streamed = service.client.post(
            "/v1/watermarks", content=parts(), headers={"Content-Type": "multipart/form-data; boundary=x"}
        )
        assert psutil.Process(process.pid).memory_info().rss < 200 * 2**20
    for response in (declared, streamed):
        assert (response.status_code, response.json()["code"]) == (413, "upload_too_large")
    assert sent < 100
