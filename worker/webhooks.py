"""`python -m worker.webhooks [PID]`: sends webhooks; given a process, it ends with it.

A process of its own on a queue of its own: slow or missing endpoints delay no job. Its threads only wait for endpoints,
so there are many.
"""

import random
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import structlog
from celery import Celery
from celery.signals import setup_logging, worker_init, worker_shutting_down
from kombu.exceptions import KombuError
from sqlalchemy.exc import OperationalError

from service.config import Settings, load_settings
from service.data_folder import keep_private
from service.jobs.clock import now
from service.jobs.ledger import Ledger
from service.jobs.queue import create_queue
from service.logs import configure_logs
from service.metrics import WEBHOOK_ATTEMPTS, metrics_server
from service.outbound.client import OutboundClient
from service.stores import require_secrets
from service.webhooks import deliveries, queue
from service.webhooks.deliver import TIMEOUTS, Outcome, deliver, not_made
from service.webhooks.slots import Slots
from service.webhooks.vault import UnreadableSecretError, Vault, read_keys
from worker.child import die_with_parent
from worker.receiving import receive, required, run_until_stopped, take
from worker.repeating import repeatedly

CONCURRENCY = 32  # threads, each with one attempt
INTERVAL = 0.5  # seconds between two queries for due deliveries
LOST_INTERVAL = 5.0  # seconds between two queries for lost messages

log = structlog.get_logger(__name__)


@dataclass
class Sender:
    """Shared state of a sender process's tasks."""

    settings: Settings
    celery: Celery
    stopping: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.ledger = Ledger(self.settings.ledger_url, self.settings.retention_seconds)
        self.client = OutboundClient(self.settings.outbound, TIMEOUTS)
        self.vault = Vault(read_keys(self.settings.secrets_key))
        self.slots = Slots(CONCURRENCY)

    def send(self, delivery_id: str) -> None:
        """Make one attempt if it is due; a duplicate or unknown id changes nothing."""
        try:
            claim = deliveries.claim(self.ledger.sessions, delivery_id)
            if claim is None:
                return
            if not self.slots.acquire(claim.tenant):
                deliveries.put_back(self.ledger.sessions, claim)
                return
            try:
                self._send(claim)
            finally:
                self.slots.release(claim.tenant)
        except UnreadableSecretError:  # nothing goes out unsigned: it is found to be due again
            log.error("the secret of a webhook is encrypted with a key that is not known here", delivery=delivery_id)
        except OperationalError as error:  # it is found to be due again
            log.warning("the job ledger does not answer", delivery=delivery_id, error=str(error.orig))

    def _send(self, claim: deliveries.Claim) -> None:
        with structlog.contextvars.bound_contextvars(delivery=claim.delivery_id, attempt=claim.attempt):
            outcome = self._attempt(claim)
            if deliveries.settle(self.ledger.sessions, claim, outcome):
                WEBHOOK_ATTEMPTS.labels(outcome.result).inc()
                log.info("webhook tried", result=outcome.result.value, status=outcome.status, error=outcome.error)

    def _attempt(self, claim: deliveries.Claim) -> Outcome:
        draw = random.random()
        secrets = [*map(self.vault.unseal, claim.secrets)]
        try:
            return deliver(self.client, claim.url, secrets, claim.message, claim.attempt, now(), draw)
        except Exception:
            log.exception("the sender failed")
            return not_made(claim.attempt, now(), draw)


def sweep(sender: Sender, lost: bool) -> None:
    """Announce due deliveries: first attempts, retries, and now and then those whose message was lost."""
    lost = lost and queue.is_empty(sender.celery)
    due = deliveries.announce(sender.ledger.sessions, lost)
    try:
        for delivery_id in due:
            queue.send(sender.celery, delivery_id)
    except (KombuError, OSError):  # the broker does not answer
        deliveries.withdraw(sender.ledger.sessions, due)
        raise


def start_sweeper(sender: Sender) -> None:
    """Sweep in the background until the process stops."""
    looked = 0.0

    def step() -> None:
        nonlocal looked
        if lost := time.monotonic() > looked + LOST_INTERVAL:
            looked = time.monotonic()
        sweep(sender, lost)

    repeatedly("sweeper", step, INTERVAL, sender.stopping)


def create_sender(settings: Settings) -> Celery:
    """Create the Celery app that sends webhooks."""
    app = create_queue(settings)
    app.conf.update(
        task_queues={queue.QUEUE: {"exchange": queue.QUEUE, "routing_key": queue.QUEUE}},
        task_default_queue=queue.QUEUE,
    )
    receive(app, CONCURRENCY)

    @cache  # made when the worker runs: an import of the app alone shall not create folders and tables
    def sender() -> Sender:
        return Sender(settings, app)

    def send(delivery_id: str) -> None:
        sender().send(delivery_id)

    figures = ExitStack()  # never closed: they are served until the process ends

    def start() -> None:
        configure_logs(settings.log_level)  # Celery asks for it later only
        require_secrets(settings)
        figures.enter_context(metrics_server(settings.metrics_host, settings.webhooks_metrics_port))
        start_sweeper(sender())

    def stop(**_: Any) -> None:
        sender().stopping.set()

    take(app, queue.TASK, send)
    setup_logging.connect(lambda **_: configure_logs(settings.log_level), weak=False)
    worker_init.connect(required(start), weak=False)
    worker_shutting_down.connect(stop, weak=False)
    return app


def main(parent: int | None) -> None:
    """Send webhooks until a signal ends it or its parent, where one is given, is gone."""
    if parent is not None:
        die_with_parent(parent)
    settings = load_settings()
    keep_private(settings)
    run_until_stopped(create_sender(settings))


if __name__ == "__main__":
    main(int(sys.argv[1]) if sys.argv[1:] else None)
