"""A process whose thread dies ends, whatever the thread died of, so that somebody starts it again."""

import subprocess
import sys
import threading
from pathlib import Path

import pytest

from service.background import DIED, in_background
from tests.worker.waiting import PATIENCE

DYING = """
import threading
from service.background import in_background
from service.logs import configure_logs
class PanicException(BaseException): ...
def work():
    raise {what}
configure_logs("INFO")
in_background("hook-outputs-shop", work)
threading.Event().wait()
"""


@pytest.mark.parametrize(
    "what", ["PanicException('a runtime in a runtime')", "OSError('no such thing')", "SystemExit(0)"]
)
def test_a_thread_that_dies_of_anything_ends_its_process_with_a_code_and_a_line(what: str) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", DYING.format(what=what)], capture_output=True, text=True, timeout=PATIENCE
    )
    assert ended.returncode == DIED != 0
    [line] = ended.stderr.splitlines()
    assert '"level": "critical"' in line
    assert '"thread": "hook-outputs-shop"' in line
    assert what.partition("(")[0] in line


def test_a_thread_that_is_done_ends_nothing() -> None:
    done = threading.Event()
    in_background("short", done.set).join()
    assert done.is_set()


def test_no_thread_of_service_and_worker_is_started_in_any_other_way() -> None:
    root = Path(__file__).parents[2]
    sources = [path for folder in ("service", "worker") for path in (root / folder).rglob("*.py")]
    assert len(sources) > 80
    assert [path.name for path in sources if "Thread(" in path.read_text()] == ["background.py"]
