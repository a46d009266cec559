import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx2

from tests.service.harness import free_port
from tests.worker.waiting import PATIENCE, wait_until

SCRIPT = """
import logging, structlog, warnings
from service.logs import configure_logs
configure_logs("INFO")
log = structlog.get_logger("mine")
with structlog.contextvars.bound_contextvars(job="42"):
    log.info("ours", seconds=1.5)
    logging.getLogger("library").warning("theirs %s", 1)
logging.getLogger("library").debug("hidden")
try:
    raise RuntimeError("reason")
except RuntimeError:
    log.exception("failed")
warnings.warn("beware")
raise SystemError("the end")
"""


def test_every_line_is_one_json_object_with_time_level_and_job() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    ours, theirs, failed, warned, ended = map(json.loads, done.stderr.splitlines())
    assert (ours["event"], ours["level"], ours["job"], ours["seconds"]) == ("ours", "info", "42", 1.5)
    assert (theirs["event"], theirs["level"], theirs["logger"]) == ("theirs 1", "warning", "library")
    assert ours["timestamp"].endswith("Z")
    assert "RuntimeError: reason" in failed["exception"]
    assert "beware" in warned["event"]
    assert (ended["event"], ended["level"]) == ("the process failed", "critical")
    assert "SystemError: the end" in ended["exception"]
    assert done.returncode == 1


def test_a_service_logs_json_alone_says_when_it_is_ready_and_is_quiet_about_probes(tmp_path: Path) -> None:
    """From start to end, API, worker and sender of webhooks, as they are: Celery takes its leave in plain text, uvicorn
    and SQLAlchemy's pools tell each step, and probes come every few seconds for ever."""
    port, log = free_port(), tmp_path / "log"
    settings = {"MESHMARK_PORT": str(port), "MESHMARK_DATA_DIR": os.fspath(tmp_path / "data")}

    def lines(**content: str) -> list[dict[str, Any]]:
        whole = log.read_text().rpartition("\n")[0].splitlines()
        return [line for line in map(json.loads, whole) if content.items() <= line.items()]

    with log.open("wb") as file:
        service = subprocess.Popen(
            [sys.executable, "-m", "service"],
            env=os.environ | settings,
            stdout=file,
            stderr=file,
            start_new_session=True,
        )
        try:
            wait_until(lambda: service.poll() is not None or len(lines(event="ready")) == 3)
            with httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=PATIENCE) as client:
                assert [client.get(path).status_code for path in ("/healthz", "/readyz", "/nothing")] == [200, 200, 404]
            service.send_signal(signal.SIGTERM)
            assert service.wait(PATIENCE) == 0
        finally:
            service.kill()
    (api,) = lines(event="ready", logger="service")
    assert (api["address"], api["port"]) == ("127.0.0.1", port)
    assert len(lines(event="stopped")) == 3
    assert [line["path"] for line in lines(event="request answered")] == ["/nothing"]
    assert {line["level"] for line in lines()} <= {"info", "warning"}
    assert not [
        line
        for line in lines()
        if line["logger"].startswith(("uvicorn", "sqlalchemy", "celery")) or "ool" in line["event"]
    ]
