"""Task of a worker: one attempt at one job."""

import json
import os
import random
import shutil
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TypeVar

import structlog
from celery import Celery
from kombu.exceptions import KombuError
from opentelemetry.trace import SpanKind, StatusCode, get_current_span
from sqlalchemy.exc import OperationalError

from core.errors import ErrorCode, MeshmarkError
from core.processors import available_processors
from service.config import SECRETS, Settings
from service.correlation import on_behalf_of
from service.data_folder import ledger_files
from service.hooks.config import secret_files
from service.jobs import contents, copies, queue, turns
from service.jobs.artifacts import StoreUnavailableError, writing
from service.jobs.ledger import Ledger
from service.jobs.models import COMPARED, Artifact, ArtifactKind, Job, JobKind, Lease
from service.jobs.stores import open_store
from service.metrics import ARTIFACT_BYTES, JOB_SECONDS, JOB_WAIT_SECONDS
from service.tracing import tracer
from worker.child import SUFFIXES
from worker.heartbeat import Heartbeat
from worker.results import open_result, replace_result
from worker.runner import Limits, Progress, Published, Session, Verification, Work
from worker.series import Series
from worker.sources import Sources
from worker.stage_clock import StageClock, known
from worker.template import Template

# Seconds: to retry in all where store or ledger do not answer, and the exponential backoff between.
RETRY_SECONDS = 60.0
FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0
LARGEST_REPORT = 2**26  # bytes
VERIFIER = "core.verify.verify:verify"

log = structlog.get_logger(__name__)
T = TypeVar("T")


class LeaseLostError(Exception):
    """The lease is void: the job was canceled or claimed by another worker, and this attempt is discarded."""


class StoppingError(Exception):
    """The worker was told to stop."""


@dataclass
class Worker:
    """Shared state of a worker process's tasks."""

    settings: Settings
    celery: Celery
    engine: str  # "module:function"
    verifier: str = VERIFIER
    stopping: threading.Event = field(default_factory=threading.Event)
    stop_by: float = 0.0  # monotonic seconds

    def __post_init__(self) -> None:
        self.ledger = Ledger(self.settings.ledger_url, self.settings.retention_seconds)
        self.artifacts = open_store(self.settings)
        self.sources = Sources(self.settings, self.ledger.sessions)
        self.scratch = self.settings.data_dir.resolve() / "scratch"
        self.scratch.mkdir(parents=True, exist_ok=True)
        threads = self.settings.job_threads or max(1, available_processors() // self.settings.worker_concurrency)
        self.template = Template(self.engine, threads)

    def close(self) -> None:
        """Close the template of the jobs' processes, and the connections to the ledger."""
        self.template.close()
        self.ledger.close()

    def stop(self) -> None:
        """Shut down gracefully: begin no more jobs, and give back those that do not end within the shutdown time."""
        self.stop_by = time.monotonic() + self.settings.shutdown_seconds
        self.stopping.set()

    def run(self, job_id: str) -> None:
        """Attempt the job that is next in this one's queue; where none waits, the message changes nothing.

        After a job that copies may follow, whose process has read their asset, the next is attempted at once.
        """
        if self.stopping.is_set():
            self.announce(job_id)
            return
        waits_in = turns.queue_of(self.ledger.sessions, job_id)
        job = waits_in and turns.claim_next(self.ledger, waits_in, self.settings.lease_seconds)
        if not job:
            log.info("message dropped: no job is waiting", job=job_id)
        with Series() as series:
            while job:
                self._observed(job, series)
                if not series.waits or self.stopping.is_set():
                    return
                job = turns.claim_next(self.ledger, job.queue, self.settings.lease_seconds)

    def _observed(self, job: Job, series: Series) -> None:
        """Attempt a job, under the eyes of logs, metrics and traces."""
        if job.attempts == 1 and job.started_at:
            JOB_WAIT_SECONDS.observe((job.started_at - job.created_at).total_seconds())
        ids: dict[str, str | int] = {"job": job.id, "attempt": job.attempts}
        with (
            on_behalf_of(job.correlation),
            structlog.contextvars.bound_contextvars(**ids),
            JOB_SECONDS.time(),
            tracer.start_as_current_span("job", kind=SpanKind.CONSUMER, attributes=ids),
        ):
            self._attempt(job, series)

    def announce(self, job_id: str) -> None:
        """Announce a waiting job."""
        if waits_in := turns.queue_of(self.ledger.sessions, job_id):
            log.info("job announced", job=job_id)
            queue.send(self.celery, job_id, waits_in)

    def _attempt(self, job: Job, series: Series) -> None:
        lease, began = job.lease, time.monotonic()
        folder = self.scratch / scratch_name(lease)
        signed = self.settings.c2pa_chain is not None and job.kind is JobKind.WATERMARK
        source = job.artifact(ArtifactKind.INPUT)
        log.info("job started")
        try:
            session = series.go_on(job, folder)
            if session is None:
                with writing():
                    folder.mkdir()
            with Heartbeat(self.ledger, lease, self.settings.lease_seconds) as heartbeat:
                contents.discard(self.ledger, self.artifacts, self.ledger.drop_outputs(lease))
                source = source or self._bring(job, folder, heartbeat)
                if source is None:  # canceled between the claim and here
                    raise LeaseLostError
                if session is None:
                    work = self._prepared(job, source, folder, heartbeat)
                    session = series.start(self.template, work, self._limits)
                self._work(job, session, heartbeat)
                if not _followed(job):
                    series.end()  # before its end is told, so that then nothing is left of it
                finish = self.ledger.hand_over if signed else self.ledger.succeed
                if not self._retried(heartbeat, lambda: finish(lease)):
                    raise LeaseLostError
            done = "job waits for its credentials" if signed else "job succeeded"
            log.info(done, seconds=round(time.monotonic() - began, 2))
            if not signed:
                self._announce_copies(job)
            self._keep(job, series)
        except (StoreUnavailableError, OperationalError) as error:
            self.ledger.release(lease)  # without a message: a sweeper announces it again after a while
            log.warning("job put back: the artifact store or the ledger does not answer", reason=str(error))
        except MeshmarkError as error:
            self.ledger.fail(lease, error)
            get_current_span().set_status(StatusCode.ERROR, error.code)
            log.info("job failed", code=error.code.value, reason=error.message)
        except LeaseLostError:
            log.info("job given up: it was canceled or handed to another worker")
        except StoppingError:
            if self.ledger.release(lease):
                queue.send(self.celery, job.id, job.queue)
            log.info("job given back: the worker is stopping")
        except Exception:
            log.exception("the worker failed")
            get_current_span().set_status(StatusCode.ERROR, INTERNAL.code)
            self.ledger.fail(lease, INTERNAL)
        finally:
            if not series.waits:
                series.end()
                shutil.rmtree(folder, ignore_errors=True)
            if source and not job.keeps_input:  # forgotten with the job's end, if it has ended
                with suppress(OperationalError):  # then a sweeper removes it
                    compared = (job.artifact(kind) for kind in COMPARED[1:])
                    contents.discard(
                        self.ledger, self.artifacts, {source.sha256, *(file.sha256 for file in compared if file)}
                    )

    def _keep(self, job: Job, series: Series) -> None:
        """Let the job's process wait for copies, if there may be some."""
        if job.copy_of:
            series.keep(job)
        elif _followed(job):
            with suppress(OperationalError):
                if published := self.ledger.get(job.id, job.tenant_id):
                    series.keep(published)

    def _announce_copies(self, job: Job) -> None:
        """Announce the copies that a job's success has let go; what fails here, a sweeper makes up for."""
        try:
            for copy in copies.queued(self.ledger.sessions, job.id):
                queue.send(self.celery, copy, job.queue)
        except (KombuError, OSError, OperationalError) as error:
            log.warning("copies could not be announced; a sweeper will find them", error=str(error))

    @property
    def _limits(self) -> Limits:
        return Limits(self.settings.job_time_limit, self.settings.job_memory_limit)

    def _prepared(self, job: Job, source: Artifact, folder: Path, heartbeat: Heartbeat) -> Work:
        """The call of the engine for a job, with the files that it needs in its folder."""
        parts = (ArtifactKind.FONT, ArtifactKind.LOGO, ArtifactKind.PLACEMENT, ArtifactKind.TEXTS)
        given = {kind: part for kind in parts if (part := job.artifact(kind))}
        verification = None
        if job.kind is JobKind.VERIFICATION:
            assert job.started_at is not None
            files = {kind: job.artifact(kind) for kind in COMPARED[1:]}
            verification = Verification(
                verifier=self.verifier,
                filename=job.filename,
                moment=job.started_at.isoformat(),
                files={
                    kind.value: os.fspath(self._fetch(job.lease, file, folder, heartbeat))
                    for kind, file in files.items()
                    if file
                },
                anchors=self._anchors(),
            )
        fetched = {kind: self._fetch(job.lease, part, folder, heartbeat) for kind, part in given.items()}
        return Work(
            input=self._fetch(job.lease, source, folder, heartbeat),
            font=fetched.get(ArtifactKind.FONT),
            logo=fetched.get(ArtifactKind.LOGO),
            placement=fetched.get(ArtifactKind.PLACEMENT),
            texts=fetched.get(ArtifactKind.TEXTS),
            parameters=job.parameters,
            budgets=self.settings.budgets,
            folder=folder,
            private=private_folders(self.settings),
            sandbox=self.settings.sandbox,
            verification=verification,
            conversion=job.kind is JobKind.CONVERSION,
        )

    def _work(self, job: Job, session: Session, heartbeat: Heartbeat) -> None:
        report = session.folder / ("report" + SUFFIXES["report"])
        try:
            self._follow(job, session, heartbeat)
        except StoreUnavailableError:
            raise
        except MeshmarkError as error:
            # The engine writes the report once before it measures: then there is a watermarked model to deliver.
            if not report.exists():
                raise
            log.warning("the engine ended before it had measured its result", code=error.code.value)
            with open_result(report) as file:
                written = file.read(LARGEST_REPORT)
            with writing():
                replace_result(report, _explained(written, error))
        if job.kind is not JobKind.CONVERSION:
            self._publish(job.lease, Published(ArtifactKind.REPORT, report), heartbeat)

    def _anchors(self) -> str | None:
        """The root certificates that are trusted.

        Raises:
            OSError: their file cannot be read.
        """
        return self.settings.c2pa_trust.read_text() if self.settings.c2pa_trust else None

    def _follow(self, job: Job, session: Session, heartbeat: Heartbeat) -> None:
        """Publish the engine's artifacts except the report, and pass on its progress."""
        with ExitStack() as unless_done, StageClock() as clock:
            unless_done.callback(session.close)
            for event in session.events():
                self._check(heartbeat)
                if isinstance(event, Published) and event.kind is not ArtifactKind.REPORT:
                    self._publish(job.lease, event, heartbeat)
                if isinstance(event, Progress):
                    heartbeat.at(known(event.stage), event.fraction)
                    clock.at(event.stage)
            unless_done.pop_all()

    def _bring(self, job: Job, folder: Path, heartbeat: Heartbeat) -> Artifact | None:
        """Download an asset that the client did not send into the store, as if it had been sent."""
        path = folder / "source"
        heartbeat.at("fetching", 0.0)
        if not self._retried(
            heartbeat, lambda: self.sources.bring(job.id, path, lambda: self._check(heartbeat), heartbeat.lost.wait)
        ):
            return None
        self._publish(job.lease, Published(ArtifactKind.INPUT, path), heartbeat)
        brought = self.ledger.get(job.id, job.tenant_id)
        return brought.artifact(ArtifactKind.INPUT) if brought else None

    def _fetch(self, lease: Lease, artifact: Artifact, folder: Path, heartbeat: Heartbeat) -> Path:
        path = folder / artifact.kind
        try:
            self._retried(heartbeat, lambda: self.artifacts.fetch(artifact.sha256, artifact.size, path))
        except FileNotFoundError:
            if lease in self.ledger.running():
                raise
            raise LeaseLostError from None  # deleted by its client after the claim
        ARTIFACT_BYTES.labels(artifact.kind).inc(artifact.size)
        return path

    def _publish(self, lease: Lease, event: Published, heartbeat: Heartbeat) -> None:
        def publish() -> int | None:
            with open_result(event.path) as stream:
                size = os.fstat(stream.fileno()).st_size
                with self.artifacts.stage(stream, limit=size, name=event.kind) as staged:
                    published = contents.publish(self.ledger, self.artifacts, lease, event.kind, staged)
            return size if published else None

        size = self._retried(heartbeat, publish)
        if size is None:
            raise LeaseLostError
        ARTIFACT_BYTES.labels(event.kind).inc(size)

    def _retried(self, heartbeat: Heartbeat, call: Callable[[], T]) -> T:
        """Retry a call while store or ledger do not answer, as long as the lease holds, for at most RETRY_SECONDS."""
        deadline, pause = time.monotonic() + RETRY_SECONDS, FIRST_PAUSE
        while True:
            self._check(heartbeat)
            try:
                return call()
            except (StoreUnavailableError, OperationalError) as error:
                if time.monotonic() + pause > deadline:
                    raise
                log.warning("the artifact store or the ledger does not answer; trying again", reason=str(error))
            heartbeat.lost.wait(pause * random.uniform(0.5, 1))  # not all workers at the same moment
            pause = min(2 * pause, LONGEST_PAUSE)

    def _check(self, heartbeat: Heartbeat) -> None:
        if self.stopping.is_set() and time.monotonic() >= self.stop_by:
            raise StoppingError
        if heartbeat.lost.is_set():
            raise LeaseLostError


def _explained(report: bytes, error: MeshmarkError) -> bytes:
    """Report in which the error that ended the measurement is the reason of every missing metric.

    Raises:
        MeshmarkError: the error itself, where what the engine left is no report.
    """
    try:
        content = json.loads(report)
        if metrics := content["metrics"]:
            metrics["missing"] = dict.fromkeys(metrics["missing"], asdict(error.notice()))
    except (ValueError, LookupError, TypeError, RecursionError):
        raise error from None
    return json.dumps(content).encode()


def private_folders(settings: Settings) -> tuple[Path, ...]:
    """Folders hidden from the engine: the ledger, other jobs' files, the queue, and secrets."""
    private = [settings.data_dir.resolve(), SECRETS]
    if settings.secrets_key:
        private.append(settings.secrets_key.resolve())
    if settings.c2pa_key:
        private.append(settings.c2pa_key.resolve())
    if settings.hooks_file:
        secret = [settings.hooks_file, *secret_files(settings.hooks_file)]  # tokens and keys of buckets
        private += [path.resolve() for path in secret]
    return (*private, *ledger_files(settings))


def _followed(job: Job) -> bool:
    """True for a job after which copies of its asset may come."""
    return job.copy_of is not None or job.artifact(ArtifactKind.TEXTS) is not None


def scratch_name(lease: Lease) -> str:
    """Name of one attempt's working folder."""
    return f"{lease.job_id}.{lease.token}"


INTERNAL = MeshmarkError(
    ErrorCode.INTERNAL_ERROR,
    "The worker could not store or record this job's results.",
    "Report this job's id to the operator; the log holds the details.",
)
