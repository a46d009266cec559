import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from core.budgets import DEFAULT_BUDGETS
from core.errors import ErrorCode, MeshmarkError
from service import template as template_module
from service.jobs.models import ArtifactKind
from tests.worker.engines import asset
from tests.worker.waiting import PATIENCE, gone, wait_until
from worker.runner import Limits, Published, Work, run_engine
from worker.template import Template

SPOT = Path(__file__).parents[1] / "data" / "spot.glb"
GENEROUS = Limits(seconds=PATIENCE, memory=2**32)


def order(folder: Path, do: str = "work", **details: Any) -> Work:
    folder.mkdir()
    source = folder / "asset.obj"
    source.write_bytes(asset(do, **details))
    return Work(source, None, {"text": "HI"}, DEFAULT_BUDGETS, folder)


def told(template: Template, folder: Path, do: str = "tell_process") -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        list(run_engine(template, order(folder, do), GENEROUS))
    return caught.value


def process(template: Template, folder: Path) -> psutil.Process:
    """The template itself, as a child of it knows it."""
    return psutil.Process(json.loads(told(template, folder).message)["template"])


@contextmanager
def hanging(template: Template, folder: Path, do: str = "hang") -> Iterator[tuple[psutil.Process, list[str]]]:
    """A job under way: the process that it wrote down, and the codes of the errors that it ended with, once it has."""
    codes: list[str] = []

    def run() -> None:
        try:
            list(run_engine(template, order(folder, do), GENEROUS))
        except MeshmarkError as error:
            codes.append(error.code)

    thread, written = threading.Thread(target=run), folder / "pid"
    thread.start()
    wait_until(lambda: written.exists() and written.read_text())
    yield psutil.Process(int(written.read_text())), codes
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_each_job_has_a_process_of_its_own_with_nothing_of_the_templates(template: Template, tmp_path: Path) -> None:
    errors = [told(template, tmp_path / name) for name in ("first", "second")]
    first, second = (json.loads(error.message) for error in errors)
    assert first["template"] == second["template"]
    assert first["pid"] != second["pid"]
    assert first["session"] == first["pid"], "one group to kill, out of reach of Ctrl-C"
    assert [error.remedy for error in errors] == [str(tmp_path / "first"), str(tmp_path / "second")], "temporary files"
    opened = first["opened"]
    folder = str(tmp_path / "first")
    assert [opened[number] for number in "012"] == [f"{folder}/request", f"{folder}/stderr", f"{folder}/stderr"]
    assert opened["3"].startswith("socket:")
    assert all(path.startswith("/proc/") for number, path in opened.items() if number not in "0123"), opened


def test_jobs_of_several_threads_get_their_own_answers(template: Template, tmp_path: Path) -> None:
    models: dict[str, bytes] = {}

    def run(text: str) -> None:
        work = order(tmp_path / text)
        work = Work(work.input, None, {"text": text}, work.budgets, work.folder)
        for event in run_engine(template, work, GENEROUS):
            if isinstance(event, Published) and event.kind is ArtifactKind.MODEL:
                models[text] = event.path.read_bytes()

    threads = [threading.Thread(target=run, args=(f"J{number}",)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    assert models == {text: b"glTF of " + text.encode() for text in (f"J{number}" for number in range(8))}
    template_process = process(template, tmp_path / "then")
    assert template_process.children() == [], "no zombie is left"
    assert template_process.num_fds() <= 5, "nor a descriptor of a job"


def test_a_template_that_is_killed_takes_its_jobs_with_it_and_the_next_job_has_another(
    template: Template, tmp_path: Path
) -> None:
    before = process(template, tmp_path / "before")
    with hanging(template, tmp_path / "running") as (child, codes):
        before.kill()
    assert codes == [ErrorCode.ENGINE_CRASHED]
    wait_until(lambda: gone(child))
    assert process(template, tmp_path / "after") != before


def test_a_template_that_dies_while_it_loads_fails_the_job_and_not_the_worker(tmp_path: Path) -> None:
    with closing(Template("tests.worker.no_such_engine:any", threads=1)) as broken:
        assert told(broken, tmp_path / "job").code == ErrorCode.ENGINE_CRASHED


def test_a_template_that_does_not_answer_is_replaced(
    template: Template, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stuck = process(template, tmp_path / "before")
    stuck.suspend()
    # Little time only for a template that answers never: one that loads may need more.
    with monkeypatch.context() as hasty:
        hasty.setattr(template_module, "START_SECONDS", 1.0)
        assert told(template, tmp_path / "does not begin").code == ErrorCode.ENGINE_CRASHED
    wait_until(lambda: gone(stuck))
    other = process(template, tmp_path / "another")
    with monkeypatch.context() as hasty, hanging(template, tmp_path / "does not end") as (child, codes):
        hasty.setattr(template_module, "END_SECONDS", 1.0)
        other.suspend()
        child.kill()
    assert codes == [ErrorCode.ENGINE_CRASHED]
    wait_until(lambda: gone(other))
    assert process(template, tmp_path / "the third") != other


def test_nothing_survives_a_worker_that_is_killed(tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from worker.runner import *; from worker.template import Template\n"
        "from core.budgets import DEFAULT_BUDGETS\n"
        "source, folder = map(Path, sys.argv[1:])\n"
        "work = Work(source, None, {'text': 'HI'}, DEFAULT_BUDGETS, folder)\n"
        "list(run_engine(Template('tests.worker.engines:directed', 1), work, Limits(60, 2**32)))"
    )
    work = order(tmp_path / "job", "spawn")
    worker = subprocess.Popen([sys.executable, "-c", script, work.input, work.folder])
    written = work.folder / "pid"
    wait_until(lambda: written.exists() and written.read_text())
    family = psutil.Process(worker.pid).children(recursive=True)
    assert len(family) == 3, "the template, the job's process, and what that started"
    worker.send_signal(signal.SIGKILL)
    worker.wait()
    wait_until(lambda: all(map(gone, family)))


def test_a_job_that_is_given_up_before_it_begins_does_not_wait_for_the_template(tmp_path: Path) -> None:
    others = psutil.Process().children()
    with closing(Template("tests.worker.engines:directed", threads=1)) as slow:
        slow.start()
        [loading] = [child for child in psutil.Process().children() if child not in others]
        loading.suspend()
        run = run_engine(slow, order(tmp_path / "job", "hang"), GENEROUS)
        next(run)
        run.close()  # else the template is waited for, and killed in the end
        loading.resume()
        assert process(slow, tmp_path / "next") == loading
        assert loading.children() == []


def test_a_real_job_imports_nothing_any_more_and_makes_the_bytes_of_a_process_of_its_own(tmp_path: Path) -> None:
    parameters = {"text": "watermark", "count": 4, "color": "#d02020"}
    results = []
    with closing(Template("tests.worker.real_engine:observed", threads=2)) as template:
        for name in ("first", "second"):
            folder = tmp_path / name
            folder.mkdir()
            work = Work(SPOT, None, parameters | {"evaluate": "full"}, DEFAULT_BUDGETS, folder)
            for _ in run_engine(template, work, GENEROUS):
                pass
            results.append((folder / "model.glb").read_bytes())
            report = json.loads((folder / "report.json").read_text())
            imported = [module for module in report["imported"] if module.split(".")[0] not in sys.stdlib_module_names]
            assert imported == []
            assert report["metrics"]["missing"].keys() <= {"ss"}
    command = [sys.executable, "-c", "import sys; from core.cli import main; sys.exit(main())", "apply"]
    alone = tmp_path / "alone.glb"
    options = ["--text", "watermark", "--count", "4", "--color", "#d02020", "--evaluate", "none"]
    environment = os.environ | {"OMP_NUM_THREADS": "2"}
    subprocess.run([*command, str(SPOT), str(alone), *options], check=True, env=environment, capture_output=True)
    assert results == [alone.read_bytes()] * 2
