"""Build the Celery app that runs jobs."""

import sys
from contextlib import ExitStack
from functools import cache
from logging import INFO, WARNING
from typing import Any

import structlog
from celery import Celery
from celery.signals import setup_logging, task_postrun, task_prerun, worker_init, worker_shutdown, worker_shutting_down

from service.background import in_background
from service.config import Settings
from service.credentials import require_trust
from service.jobs.queue import TASK, create_queue
from service.logs import configure_logs
from service.metrics import metrics_server
from service.stores import require_own_store
from service.tracing import configure_tracing
from worker import sandbox
from worker.hook_outputs import start_writer
from worker.pulse import Pulse
from worker.receiving import receive, required, take
from worker.sweeper import start_sweeper
from worker.tasks import VERIFIER, Worker, private_folders

log = structlog.get_logger(__name__)
ENGINE = "core.pipeline:watermark"


def require_sandbox(worker: Worker) -> None:
    """Log which protections the engine's sandbox has here.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where one is missing and the settings require it.
    """
    in_force = sandbox.probe(worker.scratch, private_folders(worker.settings))
    lacking = ", ".join(part for part, there in in_force.items() if not there)
    log.log(WARNING if lacking else INFO, "what the engine's process is shut off from", **in_force)
    if lacking and worker.settings.sandbox == "required":
        print(
            f"This system cannot shut the engine off from: {lacking}. It takes Linux 5.13 with Landlock and seccomp on "
            "x86-64 or ARM64; or set MESHMARK_SANDBOX=auto.",
            file=sys.stderr,
        )
        sys.exit(2)


def create_worker(settings: Settings, engine: str = ENGINE, verifier: str = VERIFIER) -> Celery:
    """Create the Celery app that runs jobs with the engine and the verifier at import paths "module:function"."""
    app = create_queue(settings)
    receive(app, settings.worker_concurrency)

    @cache
    def pulse() -> Pulse:
        return Pulse(settings, app)

    @cache  # made when the worker runs: an import of the app alone shall not create folders and tables
    def worker() -> Worker:
        return Worker(settings, app, engine, verifier)

    def attempt(job_id: str) -> None:
        worker().run(job_id)

    figures = ExitStack()  # never closed: they are served until the process ends

    def prepare() -> None:
        configure_logs(settings.log_level)  # Celery asks for it later only
        configure_tracing("meshmark-worker")
        require_own_store(settings)
        require_trust(settings)
        worker().template.start()  # it loads its libraries while all else gets ready
        require_sandbox(worker())
        in_background("pulse", pulse().beat_until, worker().stopping)
        figures.enter_context(metrics_server(settings.metrics_host, settings.worker_metrics_port))
        start_sweeper(worker())
        start_writer(worker())

    def stop(**_: Any) -> None:
        worker().stop()

    def end(**_: Any) -> None:
        worker().close()

    take(app, TASK, attempt)
    setup_logging.connect(lambda **_: configure_logs(settings.log_level), weak=False)
    worker_init.connect(required(prepare), weak=False)
    task_prerun.connect(lambda **_: pulse().began(), weak=False)
    task_postrun.connect(lambda **_: pulse().ended(), weak=False)
    worker_shutting_down.connect(stop, weak=False)
    worker_shutdown.connect(end, weak=False)
    return app
