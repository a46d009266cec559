"""Announcements of new jobs to the workers, which no client waits for.

Messages are sent from a few threads of their own: a broker that hangs would else, job by job, hold every thread that
answers requests. A job that could not be announced is found in the ledger by a worker's sweeper.
"""

import structlog
from anyio import CapacityLimiter, to_thread
from celery import Celery
from kombu.exceptions import KombuError

from service.jobs import queue
from service.jobs.models import Job, JobState

THREADS = 4  # that send messages to the broker
MOST = 200  # announcements that may be pending

log = structlog.get_logger(__name__)


class Announcer:
    """Announces the jobs that one API process accepts."""

    def __init__(self, broker: Celery) -> None:
        self._broker = broker
        self._threads = CapacityLimiter(THREADS)
        self._waiting = 0

    async def announce(self, job: Job) -> None:
        """Announce a queued job. A broker that does not answer delays its start, and loses nothing."""
        if job.state != JobState.QUEUED:
            return
        if self._waiting >= MOST:
            _untold(job, f"{MOST} jobs wait to be announced")
            return
        self._waiting += 1
        try:
            await to_thread.run_sync(
                queue.send, self._broker, job.id, job.queue, limiter=self._threads, abandon_on_cancel=True
            )
        except (KombuError, OSError) as error:
            _untold(job, str(error))
        finally:
            self._waiting -= 1


def _untold(job: Job, reason: str) -> None:
    log.error("the broker does not answer; a worker's sweeper will find the job", job=job.id, error=reason)
