"""Liveness of a worker: a file that is touched while it takes messages, and `python -m worker --check`.

A worker whose process lives may have stopped consuming, for example after its broker was restarted. The symptom is that
messages wait in a queue that it serves, it has a free slot, and none comes. A broker that does not answer is no reason
to restart the worker.
"""

import os
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path

import psutil
import structlog
from celery import Celery
from kombu.exceptions import KombuError

from service.config import Settings
from service.jobs.models import Queue
from service.jobs.queue import depth, name

log = structlog.get_logger(__name__)


class Pulse:
    """Counts a worker's running messages, and beats while it consumes as it should.

    It beats four times per lease, until messages have waited for two leases beside a free slot.
    """

    def __init__(self, settings: Settings, broker: Celery) -> None:
        self._broker, self._places = broker, settings.worker_concurrency
        self._interval, self._patience = settings.lease_seconds / 4, 2 * settings.lease_seconds
        self._lock = threading.Lock()
        self._busy, self._healthy_at = 0, time.monotonic()
        folder = _folder(settings)
        folder.mkdir(parents=True, exist_ok=True)
        for path in folder.iterdir():
            if _process(path) is None:
                path.unlink(missing_ok=True)
        self.path = folder / f"{socket.gethostname()}.{os.getpid()}"

    def began(self) -> None:
        """Count a message that was taken."""
        with self._lock:
            self._busy, self._healthy_at = self._busy + 1, time.monotonic()

    def ended(self) -> None:
        """Count a message that is done."""
        with self._lock:
            self._busy, self._healthy_at = self._busy - 1, time.monotonic()

    def beat(self) -> None:
        """Touch the file, unless messages have waited for too long."""
        expecting = self._busy < self._places and self._messages_wait()
        if not expecting:
            self._healthy_at = time.monotonic()
        if time.monotonic() < self._healthy_at + self._patience:
            self.path.touch()
        else:
            log.error("messages wait, there is a free place, and none comes: this worker should be restarted")

    def beat_until(self, over: threading.Event) -> None:
        """Beat regularly."""
        while True:
            try:
                self.beat()
            except OSError as error:  # a full disk, which ends by itself
                log.warning("the worker's sign of life cannot be written", error=str(error))
            if over.wait(self._interval):
                return

    def _messages_wait(self) -> bool:
        served = self._broker.amqp.queues.consume_from
        try:
            return any(depth(self._broker, queue) for queue in Queue if name(queue) in served)
        except (KombuError, OSError) as error:
            log.warning("the broker does not answer", error=str(error))
            return False


def check(settings: Settings) -> str | None:
    """Check the workers of this machine (of this container) and this data folder; returns a fault in words, or None."""
    latest = time.time() - 4 * settings.lease_seconds
    alive = {path: process for path in _folder(settings).glob("*") if (process := _process(path))}
    if not alive:
        return "No worker runs here."
    for path, process in alive.items():
        with suppress(FileNotFoundError):
            if path.stat().st_mtime < latest:
                return f"The worker with process id {process} has stopped taking messages."
    return None


def _folder(settings: Settings) -> Path:
    return settings.data_dir.resolve() / "workers"


def _process(path: Path) -> int | None:
    """Process id in a file's name, if it is a living process of this machine."""
    host, _, process = path.name.rpartition(".")
    if host != socket.gethostname() or not process.isdecimal() or not psutil.pid_exists(int(process)):
        return None
    return int(process)
