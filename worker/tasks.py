"""The task behind a message: one attempt at one job."""

import json
import os
import shutil
import threading
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import structlog
from celery import Celery

from core.errors import ErrorCode, MeshmarkError
from service.config import Settings
from service.jobs import queue
from service.jobs.artifacts import ArtifactStore
from service.jobs.ledger import Content, Ledger
from service.jobs.models import ArtifactKind, Job, Lease
from worker.child import SUFFIXES
from worker.runner import Limits, Progress, Published, Work, run_engine

HEARTBEAT = 1.0  # seconds; also how long a cancellation may go unnoticed

log = structlog.get_logger(__name__)


class LeaseLostError(Exception):
    """The job was canceled, or handed to another worker: whatever this one has is of no use any more."""


class StoppingError(Exception):
    """The worker was told to stop."""


@dataclass
class Worker:
    """What the tasks of one worker process share."""

    settings: Settings
    celery: Celery
    engine: str  # "module:function"
    stopping: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.ledger = Ledger(self.settings.ledger_url)
        self.artifacts = ArtifactStore(self.settings.data_dir.resolve() / "artifacts")
        self.scratch = self.settings.data_dir.resolve() / "scratch"
        self.scratch.mkdir(parents=True, exist_ok=True)

    def run(self, job_id: str) -> None:
        """Try a job if it is there to be taken; a duplicate or unknown id changes nothing."""
        if self.stopping.is_set():
            queue.send(self.celery, job_id)
            return
        job = self.ledger.claim(job_id, self.settings.lease_seconds)
        if job is None:
            log.info("message dropped: the job is not waiting", job=job_id)
            return
        with structlog.contextvars.bound_contextvars(job=job.id, attempt=job.attempts):
            self._attempt(job)

    def _attempt(self, job: Job) -> None:
        lease, began = job.lease, time.monotonic()
        folder = self.scratch / scratch_name(lease)
        log.info("job started")
        try:
            folder.mkdir()
            with self.artifacts.exclusive():
                for sha256 in self.ledger.drop_outputs(lease):
                    self.artifacts.remove(sha256)
            self._work(job, folder)
            if not self.ledger.succeed(lease):
                raise LeaseLostError
            log.info("job succeeded", seconds=round(time.monotonic() - began, 2))
        except MeshmarkError as error:
            self.ledger.fail(lease, error)
            log.info("job failed", code=error.code.value, reason=error.message)
        except LeaseLostError:
            log.info("job given up: it was canceled or handed to another worker")
        except StoppingError:
            if self.ledger.release(lease):
                queue.send(self.celery, job.id)
            log.info("job given back: the worker is stopping")
        except Exception:
            log.exception("the worker failed")
            self.ledger.fail(lease, INTERNAL)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _work(self, job: Job, folder: Path) -> None:
        source, font = job.artifact(ArtifactKind.INPUT), job.artifact(ArtifactKind.FONT)
        if source is None:  # canceled between the claim and here
            raise LeaseLostError
        work = Work(
            engine=self.engine,
            input=self.artifacts.path(source.sha256),
            font=self.artifacts.path(font.sha256) if font else None,
            parameters=job.parameters,
            budgets=self.settings.budgets,
            folder=folder,
        )
        threads = self.settings.job_threads or max(1, len(os.sched_getaffinity(0)) // self.settings.worker_concurrency)
        limits = Limits(self.settings.job_time_limit, self.settings.job_memory_limit, threads)
        report = folder / ("report" + SUFFIXES["report"])
        try:
            self._follow(job, work, limits)
        except MeshmarkError as error:
            # The engine writes the report once before it measures: then there is a watermarked model to deliver.
            if not report.exists():
                raise
            log.warning("the engine ended before it had measured its result", code=error.code.value)
            report.write_bytes(_explained(report.read_bytes(), error))
        self._publish(job.lease, Published(ArtifactKind.REPORT, report))

    def _follow(self, job: Job, work: Work, limits: Limits) -> None:
        """Run the engine, publish what it makes but the report, and pass on how it goes."""
        beat = min(HEARTBEAT, self.settings.lease_seconds / 4)
        at, due = Progress("reading", 0.0), 0.0
        with closing(run_engine(work, limits)) as events:
            for event in events:
                if self.stopping.is_set():
                    raise StoppingError
                if isinstance(event, Published) and event.kind is not ArtifactKind.REPORT:
                    self._publish(job.lease, event)
                if isinstance(event, Progress):
                    if event.stage != at.stage:
                        due = 0.0  # a new stage shows at once
                    at = event
                if time.monotonic() >= due:
                    if not self.ledger.heartbeat(job.lease, self.settings.lease_seconds, at.stage, at.fraction):
                        raise LeaseLostError
                    due = time.monotonic() + beat

    def _publish(self, lease: Lease, event: Published) -> None:
        with (
            event.path.open("rb") as stream,
            self.artifacts.stage(stream, limit=event.path.stat().st_size, name=event.kind) as staged,
            self.artifacts.exclusive(),
        ):
            self.artifacts.add(staged)
            if self.ledger.publish(lease, event.kind, Content(staged.sha256, staged.size)):
                return
            for sha256 in self.ledger.unreferenced([staged.sha256]):
                self.artifacts.remove(sha256)
            raise LeaseLostError


def _explained(report: bytes, error: MeshmarkError) -> bytes:
    """The report with what ended the measurement as the reason of every metric that is missing."""
    content = json.loads(report)
    if content["metrics"] is not None:
        reason = {"code": error.code.value, "message": error.message, "remedy": error.remedy}
        content["metrics"]["missing"] = dict.fromkeys(content["metrics"]["missing"], reason)
    return json.dumps(content).encode()


def scratch_name(lease: Lease) -> str:
    """The working folder's name of one attempt."""
    return f"{lease.job_id}.{lease.token}"


INTERNAL = MeshmarkError(
    ErrorCode.INTERNAL_ERROR,
    "The worker could not store or record this job's results.",
    "Report this job's id to the operator; the log holds the details.",
)
