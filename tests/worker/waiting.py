"""Wait for what other processes do."""

import time
from collections.abc import Callable

import psutil

PATIENCE = 300.0  # seconds; for what comes in a moment, on however slow a machine


def wait_until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.05)


def gone(process: psutil.Process) -> bool:
    """Ended, whether or not anyone has asked for its exit code."""
    try:
        return bool(process.status() == psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return True
