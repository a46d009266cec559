"""Prometheus metrics of this process, served on a port of their own.

Every process serves its own: an API those of its requests and, read from the ledger, of the queued and running jobs; a
worker those of the jobs it ran, a sender of webhooks those of its attempts. Prometheus sums the counters (`sum`), and
takes the ledger's gauges from any process (`max`). A worker is one process with threads, and the engine's processes
report to it, so nothing is shared between processes and nothing is counted twice. Labels have few values: none comes
from a client.
"""

import platform
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import structlog
from prometheus_client import REGISTRY, CollectorRegistry, Counter, Histogram, Info, start_http_server
from prometheus_client.registry import Collector

from core import __version__
from service.background import in_background

# Upper bounds of histogram buckets, in seconds: of requests, of work, of waiting.
REQUEST_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
WORK_SECONDS = (0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0)
WAIT_SECONDS = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 900.0, 3600.0)

HTTP_REQUESTS = Counter("meshmark_http_requests", "Requests answered.", ["method", "route", "status"])
HTTP_SECONDS = Histogram(
    "meshmark_http_request_seconds", "Until an answer was sent whole.", ["method", "route"], buckets=REQUEST_SECONDS
)
HTTP_BYTES = Counter("meshmark_http_bytes", "Bytes of requests and answers, without headers.", ["direction", "route"])
PROBLEMS = Counter("meshmark_problems", "Errors that requests were answered with.", ["code"])
JOBS_ACCEPTED = Counter("meshmark_jobs_accepted", "Jobs recorded.")
JOBS_ENDED = Counter("meshmark_jobs_ended", "Jobs that ended; the code of those that failed.", ["state", "code"])
JOB_WAIT_SECONDS = Histogram(
    "meshmark_job_wait_seconds", "From the acceptance of a job to its first start.", buckets=WAIT_SECONDS
)
JOB_SECONDS = Histogram("meshmark_job_seconds", "Of a worker with one attempt at a job.", buckets=WORK_SECONDS)
STAGE_SECONDS = Histogram("meshmark_stage_seconds", "Of an attempt by stage.", ["stage"], buckets=WORK_SECONDS)
ARTIFACT_BYTES = Counter("meshmark_artifact_bytes", "Bytes that workers fetched and published.", ["kind"])
WEBHOOK_ATTEMPTS = Counter("meshmark_webhook_attempts", "Attempts to send a webhook, by what came of them.", ["result"])
CREDENTIALS = Counter("meshmark_credentials", "Attempts to sign a result, by what came of them.", ["result"])
BUILD = Info("meshmark_build", "What runs here.")
BUILD.info({"version": __version__, "python": platform.python_version()})

log = structlog.get_logger(__name__)


def ended(done: bool, state: str, code: str = "") -> bool:
    """Count a job if it ended here; returns `done`."""
    if done:
        JOBS_ENDED.labels(state, code).inc()
    return done


@contextmanager
def metrics_server(host: str, port: int, *collectors: Collector) -> Iterator[None]:
    """Serve this process's metrics, and those of the collectors, during the block; port 0: do not.

    Raises:
        SystemExit: the port cannot be opened.
    """
    if not port:
        yield
        return
    registry = CollectorRegistry(auto_describe=False)
    for collector in (REGISTRY, *collectors):
        registry.register(collector)
    try:
        server, thread = start_http_server(port, host, registry)
    except OSError as error:
        log.error("the port of the metrics cannot be opened", host=host, port=port, error=str(error))
        raise SystemExit(2) from error  # Celery would go on after anything less
    over = threading.Event()
    in_background("metrics", _require, thread, over)
    try:
        yield
    finally:
        over.set()
        server.shutdown()
        server.server_close()
        thread.join()


def _require(thread: threading.Thread, over: threading.Event) -> None:
    """Supervise a thread that a library has started.

    Raises:
        RuntimeError: it ended too early.
    """
    thread.join()
    if not over.is_set():
        raise RuntimeError("the metrics are not served any more")
