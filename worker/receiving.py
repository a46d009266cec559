"""Setup and start of the Celery apps that receive messages, of jobs and of webhooks."""

import signal
import warnings
from collections.abc import Callable
from typing import Any

import structlog
from celery import Celery
from celery.apps import worker as celery_worker
from celery.exceptions import SecurityWarning
from celery.signals import worker_ready, worker_shutdown

from service.background import end_process
from service.hangup import hangup_handler

log = structlog.get_logger(__name__)


def receive(app: Celery, concurrency: int) -> None:
    """Configure an app to receive messages with so many threads.

    Threads: each only waits, for a child process of its own or for a server, so it needs neither its own interpreter
    nor billiard's daemonic processes, which may not have children; and the consumer's thread stays free to keep the
    broker's connection and to obey signals, which the solo pool cannot while a task runs.
    """
    app.conf.update(
        worker_pool="threads",
        worker_concurrency=concurrency,
        worker_prefetch_multiplier=1,
        task_acks_late=True,
        worker_hijack_root_logger=False,
        worker_redirect_stdouts=False,
        # Neither remote control nor events are used; on the file broker each would leave a queue of files behind.
        worker_enable_remote_control=False,
        worker_send_task_events=False,
        worker_cancel_long_running_tasks_on_connection_loss=False,  # the ledger decides, not the connection
    )
    hangup = hangup_handler()
    # In place of Celery's own handler, which restarts the worker in the background and ignores `nohup`.
    worker_ready.connect(lambda **_: signal.signal(signal.SIGHUP, hangup), weak=False)


def take(app: Celery, task: str, work: Callable[[str], None]) -> None:
    """Register a task that does some work for each message, which is an id.

    An error that is no Exception, such as a panic of a native library, ends the process: Celery would go on without
    taking messages.
    """

    def run(identifier: str) -> None:
        try:
            work(identifier)
        except Exception:
            raise  # Celery logs it
        except BaseException as error:
            end_process(error)

    app.task(run, name=task)


def required(step: Callable[[], None]) -> Callable[..., None]:
    """Handler of `worker_init` for a step that the worker cannot do without; Celery itself would ignore its failure."""

    def handle(**_: Any) -> None:
        try:
            step()
        except Exception as error:
            log.exception("the worker cannot start")
            raise SystemExit(2) from error

    return handle


def _say_ready(**_: Any) -> None:
    log.info("ready")


def _say_stopped(**_: Any) -> None:
    log.info("stopped")


def _say_nothing(*_: Any) -> None:
    """Replace the plain text that Celery writes to stdout at each signal; the log is JSON."""


def run_until_stopped(app: Celery, *options: str) -> None:
    """Receive messages until a signal ends it."""
    worker_ready.connect(_say_ready)
    worker_shutdown.connect(_say_stopped)
    celery_worker.safe_say = _say_nothing
    # Harmless here, where messages are JSON and never pickles; Celery still refuses to start as root with pickles.
    warnings.filterwarnings("ignore", "You're running the worker with superuser privileges", SecurityWarning)
    app.worker_main(["--quiet", "worker", "--without-gossip", "--without-mingle", "--without-heartbeat", *options])
