"""Sweeper: recovers the jobs of dead workers and lost messages, and deletes expired and orphaned files."""

import random
import shutil
import time
from datetime import timedelta
from functools import partial

import structlog

from service.jobs import contents, events, forgetting, idempotency, queue, sources, uploads
from service.jobs.artifacts import GRACE
from service.jobs.clock import now
from service.jobs.dead import WORKER_LOST
from service.jobs.models import Queue
from worker.repeating import repeatedly
from worker.tasks import Worker, scratch_name

BATCHES = 10  # of old jobs in one step, each forgotten in one transaction
SHARES = 256  # of the store, by the first two digits of the hash; all are swept once in a grace period

log = structlog.get_logger(__name__)


def sweep(worker: Worker) -> None:
    """Sweep the ledger once. Any number of workers may sweep at the same time."""
    settings = worker.settings
    requeued, failed = worker.ledger.recover(settings.max_attempts, WORKER_LOST)
    for job_id in requeued:
        worker.announce(job_id)
    for job_id in failed:
        log.warning("job failed: its worker disappeared", job=job_id)
    for each in Queue:
        # While messages wait in the broker, a job waits because of the load, not because its message was lost.
        lost = [] if queue.depth(worker.celery, each) else worker.ledger.waiting(settings.lease_seconds, each)
        for job_id in lost:
            log.warning("job announced again", job=job_id)
            queue.send(worker.celery, job_id, each)
    idempotency.forget(worker.ledger.sessions)
    events.forget(worker.ledger.sessions, now() - events.KEPT)
    sources.forget(worker.ledger.sessions)
    folders = list(worker.scratch.iterdir())  # before the leases: a folder is made after its claim
    held = {scratch_name(lease) for lease in worker.ledger.running()}
    for folder in folders:
        if folder.name not in held:
            shutil.rmtree(folder, ignore_errors=True)


def remove_expired(worker: Worker) -> None:
    """Delete the files of jobs that have expired."""
    for job_id in forgetting.overdue(worker.ledger.sessions):
        dropped = forgetting.drop_artifacts(worker.ledger.sessions, job_id)
        contents.discard(worker.ledger, worker.artifacts, dropped)
        log.info("job expired: its files are deleted", job=job_id)


def forget_old_jobs(worker: Worker) -> None:
    """Delete jobs without results that ended long ago, at most BATCHES batches of them."""
    if not (days := worker.settings.history_days):
        return
    for _ in range(BATCHES):
        number, hashes = forgetting.forget(worker.ledger.sessions, timedelta(days=days))
        contents.discard(worker.ledger, worker.artifacts, hashes)
        if number:
            log.info("old jobs are forgotten", jobs=number)
        if number < forgetting.BATCH:
            return


def sweep_store(worker: Worker, share: int) -> None:
    """Remove content that no job refers to from one of 256 shares of the store, and drafts of killed processes here."""
    worker.artifacts.clear_staging(GRACE)
    uploads.remove_expired(worker.ledger.sessions, worker.artifacts)
    for sha256 in contents.discard_orphans(worker.ledger, worker.artifacts, f"{share % SHARES:02x}"):
        log.warning("content removed: no job refers to it", sha256=sha256)


class FileSweep:
    """Deletes expired files, and sweeps the store, slowly, from a random share on."""

    def __init__(self, worker: Worker) -> None:
        self._worker = worker
        self._share, self._due = random.randrange(SHARES), time.monotonic()

    def step(self) -> None:
        """Sweep once."""
        try:
            remove_expired(self._worker)
            forget_old_jobs(self._worker)
            if time.monotonic() >= self._due:
                self._share, self._due = self._share + 1, time.monotonic() + GRACE / SHARES
                sweep_store(self._worker, self._share)
        except Exception:
            self._worker.artifacts.reserve.give_up()  # on a full disk, expired files are deleted in the reserved space
            raise


def start_sweeper(worker: Worker) -> None:
    """Sweep in the background, several times per lease, until the worker stops.

    In two threads: a store that is slow to delete delays no lost job.
    """
    interval = worker.settings.lease_seconds / 4
    repeatedly("sweeper", partial(sweep, worker), interval, worker.stopping)
    repeatedly("file-sweeper", FileSweep(worker).step, interval, worker.stopping)
