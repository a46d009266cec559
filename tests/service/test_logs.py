import json
import subprocess
import sys

SCRIPT = """
import logging, structlog
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
"""


def test_every_line_is_one_json_object_with_time_level_and_job() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    ours, theirs, failed = map(json.loads, done.stderr.splitlines())
    assert (ours["event"], ours["level"], ours["job"], ours["seconds"]) == ("ours", "info", "42", 1.5)
    assert (theirs["event"], theirs["level"], theirs["logger"]) == ("theirs 1", "warning", "library")
    assert ours["timestamp"].endswith("Z")
    assert "RuntimeError: reason" in failed["exception"]
