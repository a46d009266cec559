import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest

from core.budgets import DEFAULT_BUDGETS
from core.errors import ErrorCode, MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs.models import ArtifactKind
from tests.worker.engines import asset
from tests.worker.waiting import PATIENCE, gone, wait_until
from worker.runner import Limits, Progress, Published, Work, run_engine
from worker.template import Template

GENEROUS = Limits(seconds=PATIENCE, memory=2**32)


def order(folder: Path, do: str = "work", **details: Any) -> Work:
    source = folder / "asset.obj"
    source.write_bytes(asset(do, **details))
    scratch = folder / "scratch"
    scratch.mkdir()
    return Work(source, None, {"text": "HI"}, DEFAULT_BUDGETS, scratch)


def failure(template: Template, work: Work, limits: Limits = GENEROUS) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        for _ in run_engine(template, work, limits):
            pass
    return caught.value


def process_in(path: Path) -> psutil.Process:
    wait_until(lambda: path.exists() and path.read_text())
    return psutil.Process(int(path.read_text()))


def test_stages_and_artifacts_arrive_in_order(template: Template, tmp_path: Path) -> None:
    events = [event for event in run_engine(template, order(tmp_path), GENEROUS) if event]
    assert [event.stage if isinstance(event, Progress) else event.kind for event in events] == [
        "reading",
        "placing",
        ArtifactKind.MODEL,
        ArtifactKind.PLAN,
        ArtifactKind.REPORT,
        "evaluating",
        ArtifactKind.PREVIEW,
        ArtifactKind.REPORT,
    ]
    files = {event.kind: event.path.read_bytes() for event in events if isinstance(event, Published)}
    assert files[ArtifactKind.MODEL] == b"glTF of HI"
    assert json.loads(files[ArtifactKind.REPORT]) == {
        "text": "HI",
        "font": False,
        "logo": False,
        "metrics": {"ocr": 1.0, "missing": {}},
    }


def test_what_native_code_prints_is_not_taken_for_an_answer(template: Template, tmp_path: Path) -> None:
    events = list(run_engine(template, order(tmp_path, "chatter"), GENEROUS))
    assert any(isinstance(event, Published) and event.kind == ArtifactKind.REPORT for event in events)


def test_a_segfault_is_an_engine_crash_that_names_the_signal(template: Template, tmp_path: Path) -> None:
    error = failure(template, order(tmp_path, "segfault"))
    assert error.code == ErrorCode.ENGINE_CRASHED
    assert "SIGSEGV" in error.message


def test_an_engine_that_leaves_without_an_answer_is_an_engine_crash(template: Template, tmp_path: Path) -> None:
    error = failure(template, order(tmp_path, "leave"))
    assert error.code == ErrorCode.ENGINE_CRASHED
    assert "exit code 3" in error.message


def test_a_hang_in_native_code_ends_at_the_time_limit(template: Template, tmp_path: Path) -> None:
    assert failure(template, order(tmp_path, "hang"), Limits(seconds=1.5, memory=2**32)).code == ErrorCode.TIME_LIMIT


def test_eating_memory_ends_at_the_memory_limit(template: Template, tmp_path: Path) -> None:
    error = failure(template, order(tmp_path, "eat_memory"), Limits(seconds=PATIENCE, memory=400 * 2**20))
    assert error.code == ServiceErrorCode.MEMORY_LIMIT
    assert "400 MiB" in error.message


def test_running_out_of_memory_inside_python_is_the_memory_limit_too(template: Template, tmp_path: Path) -> None:
    assert failure(template, order(tmp_path, "run_out_of_memory")).code == ServiceErrorCode.MEMORY_LIMIT


def test_a_refusal_of_the_engine_arrives_word_for_word(template: Template, tmp_path: Path) -> None:
    error = failure(template, order(tmp_path, "refuse"))
    assert (error.code, error.message, error.remedy) == (
        ErrorCode.NO_PLACEMENT,
        "No place on this asset.",
        "Ask for smaller letters.",
    )


def test_a_bug_in_the_engine_is_an_internal_error_without_its_details(template: Template, tmp_path: Path) -> None:
    error = failure(template, order(tmp_path, "stumble"))
    assert error.code == ErrorCode.INTERNAL_ERROR
    assert "secret" not in str(error)


def test_the_engine_does_not_see_the_workers_secrets(
    template: Template, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MESHMARK_DATABASE_URL", "postgresql://user:password@host/db")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    work = order(tmp_path, "tell_environment")
    environment = json.loads(failure(template, work).message)
    assert not [name for name in environment if name.startswith(("MESHMARK_", "AWS_"))]
    assert environment["TMPDIR"] == os.fspath(work.folder)


def test_the_engine_is_told_where_to_compute(
    template: Template, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MESHMARK_DEVICE", "cuda")
    monkeypatch.setenv("WARP_CACHE_PATH", os.fspath(tmp_path))
    environment = json.loads(failure(template, order(tmp_path, "tell_environment")).message)
    assert (environment["MESHMARK_DEVICE"], environment["WARP_CACHE_PATH"]) == ("cuda", os.fspath(tmp_path))


def test_closing_the_run_kills_the_child_and_what_it_started(template: Template, tmp_path: Path) -> None:
    work = order(tmp_path, "spawn")
    pid_file = work.folder / "pid"
    run = run_engine(template, work, GENEROUS)
    for _ in run:
        if pid_file.exists() and pid_file.read_text():
            break
    grandchild = process_in(pid_file)
    run.close()
    wait_until(lambda: gone(grandchild))


def test_the_child_dies_with_a_worker_that_is_killed(tmp_path: Path) -> None:
    work = order(tmp_path, "hang")
    pid_file = work.folder / "pid"
    script = (
        "import sys; from pathlib import Path; from worker.runner import *; from worker.template import Template\n"
        "from core.budgets import DEFAULT_BUDGETS\n"
        "source, folder = map(Path, sys.argv[1:])\n"
        "work = Work(source, None, {'text': 'HI'}, DEFAULT_BUDGETS, folder)\n"
        "list(run_engine(Template('tests.worker.engines:directed', 1), work, Limits(60, 2**32)))"
    )
    parent = subprocess.Popen([sys.executable, "-c", script, work.input, work.folder])
    child = process_in(pid_file)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    wait_until(lambda: gone(child))
