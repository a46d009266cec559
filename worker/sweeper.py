"""Find what nobody works on: jobs of workers that vanished, and queued jobs whose message was lost."""

import shutil
import threading

import structlog

from service.jobs import queue
from service.jobs.ledger import WORKER_LOST
from worker.tasks import Worker, scratch_name

log = structlog.get_logger(__name__)


def sweep(worker: Worker) -> None:
    """One pass over the ledger. Any number of workers may sweep at the same time."""
    settings = worker.settings
    requeued, failed = worker.ledger.recover(settings.max_attempts, WORKER_LOST)
    for job_id in failed:
        log.warning("job failed: its worker disappeared", job=job_id)
    # While messages wait in the broker, a job that waits long is one of many and not a lost one.
    lost = [] if queue.depth(worker.celery) else worker.ledger.waiting(settings.lease_seconds)
    for job_id in [*requeued, *lost]:
        log.warning("job announced again", job=job_id)
        queue.send(worker.celery, job_id)
    folders = list(worker.scratch.iterdir())  # before the leases: a folder is made after its claim
    held = {scratch_name(lease) for lease in worker.ledger.running()}
    for folder in folders:
        if folder.name not in held:
            shutil.rmtree(folder, ignore_errors=True)


def sweep_forever(worker: Worker) -> None:
    """Sweep several times per lease until the worker stops; a failed pass is logged and the next one comes."""
    while not worker.stopping.wait(worker.settings.lease_seconds / 4):
        try:
            sweep(worker)
        except Exception:
            log.exception("sweep failed")


def start_sweeper(worker: Worker) -> threading.Thread:
    """Sweep in a background thread."""
    thread = threading.Thread(target=sweep_forever, args=(worker,), name="sweeper", daemon=True)
    thread.start()
    return thread
