"""Periodic steps of a worker, in the background."""

import threading
from collections.abc import Callable

import structlog
from kombu.exceptions import KombuError
from sqlalchemy.exc import OperationalError

from service.background import in_background
from service.jobs.artifacts import StoreUnavailableError

# Transient errors of a server or disk that does not answer, which need no action here.
AWAY = (StoreUnavailableError, OperationalError, KombuError, OSError)

log = structlog.get_logger(__name__)


def repeatedly(name: str, step: Callable[[], object], interval: float, stopping: threading.Event) -> threading.Thread:
    """Repeat a step in a background thread, with a pause of so many seconds before each, until told to stop.

    A step that fails is logged, and repeated. An outage is logged once at its beginning and once at its end.
    """

    def run() -> None:
        away = False
        while not stopping.wait(interval):
            try:
                step()
            except AWAY as error:
                reason = " ".join(str(error.orig if isinstance(error, OperationalError) else error).split())
                if not away:
                    log.warning("what a thread needs does not answer; it tries again", thread=name, error=reason)
                away = True
            except Exception:
                log.exception("a thread failed; it tries again", thread=name)
            else:
                if away:
                    log.info("what a thread needs answers again", thread=name)
                away = False

    return in_background(name, run)
