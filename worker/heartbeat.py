"""Heartbeats, which renew the lease of a job while its worker is busy, for example with a slow upload."""

import threading
import time
from types import TracebackType
from typing import Self

import structlog
from sqlalchemy.exc import OperationalError

from service.background import in_background
from service.jobs.ledger import Ledger
from service.jobs.models import Lease

INTERVAL = 1.0  # seconds between two heartbeats, and so the longest time in which a cancellation is unnoticed

log = structlog.get_logger(__name__)


class Heartbeat:
    """Renews a lease from a thread of its own, with the current stage and progress, until the block ends.

    `lost` is set when the lease is void, when the ledger could not be reached for as long as the lease holds, and when
    the ledger refuses the heartbeat.
    """

    def __init__(self, ledger: Ledger, lease: Lease, lease_seconds: float) -> None:
        self.lost = threading.Event()
        self._ledger, self._lease, self._lease_seconds = ledger, lease, lease_seconds
        self._at = ("reading", 0.0)
        self._wake = threading.Event()
        self._over = False

    def __enter__(self) -> Self:
        self._thread = in_background("heartbeat", self._run)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over = True
        self._wake.set()
        self._thread.join()

    def at(self, stage: str, fraction: float) -> None:
        """Set the current stage and share done; a new stage is sent at once."""
        if stage != self._at[0]:
            self._wake.set()
        self._at = (stage, fraction)

    def _run(self) -> None:
        renewed = time.monotonic()
        while not self._over:
            self._wake.clear()  # before reading the stage: a stage set later wakes the thread again
            try:
                if not self._ledger.heartbeat(self._lease, self._lease_seconds, *self._at):
                    break
                renewed = time.monotonic()
            except OperationalError as error:
                log.warning("the job ledger does not answer", error=str(error.orig))
                if time.monotonic() > renewed + self._lease_seconds:
                    break
            except Exception:
                log.exception("the lease cannot be renewed")
                break
            self._wake.wait(min(INTERVAL, self._lease_seconds / 4))
        else:
            return
        self.lost.set()
