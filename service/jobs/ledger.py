"""The job ledger: the single source of truth about every job.

Every transition is a single compare-and-set UPDATE, so any number of workers and duplicate messages may race for a
job and exactly one wins: PostgreSQL (READ COMMITTED) looks at the condition again once it has waited for the row, and
SQLite has one writer. A transaction that goes on to change a job's artifacts begins with such an UPDATE of the job, and
thereby locks it. A statement over many rows skips those that another process has locked (SKIP LOCKED), so that no
two can deadlock.

A worker's right to change a job is its lease: it is renewed by heartbeats, and it is void as soon as the job was
canceled, given to another worker, or finished.

Moments that are compared are those of the database's own clock: see :mod:`service.jobs.clock`.

The event of a change is recorded by the transaction of the change: see :mod:`service.jobs.transitions`.
"""

import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from sqlalchemy import select, update
from sqlalchemy.engine import make_url
from sqlalchemy.exc import DatabaseError, OperationalError
from sqlalchemy.orm import Session, sessionmaker

from core.errors import MeshmarkError
from service.correlation import correlation
from service.jobs import copies
from service.jobs.clock import clock
from service.jobs.database import connect
from service.jobs.events import record
from service.jobs.forgetting import expiry, expiry_of_ended
from service.jobs.locks import lock_keys
from service.jobs.migrations import NewerSchemaError, migrate
from service.jobs.models import (
    DEFAULT_TENANT,
    Artifact,
    ArtifactKind,
    Identity,
    Job,
    JobKind,
    JobState,
    Lease,
    MetadataEntry,
    Priority,
    Queue,
)
from service.jobs.quota import add_stored
from service.jobs.references import lock_content
from service.jobs.transitions import ACTIVE, change, drop_files, let_go, lock, move, tenant_of, under
from service.metrics import JOBS_ACCEPTED, ended

MIGRATION = 7239017  # key of the lock for migrations: an arbitrary constant
OUTPUTS = (
    *(
        ArtifactKind.MODEL,
        ArtifactKind.PLAN,
        ArtifactKind.REPORT,
        ArtifactKind.PREVIEW,
        ArtifactKind.TURNTABLE,
        ArtifactKind.POSTER,
    ),
    *(ArtifactKind.EXPLANATION, ArtifactKind.LAYERS, ArtifactKind.CREDENTIALS, ArtifactKind.EVIDENCE),
    *(ArtifactKind.PREVIEW_MODEL, ArtifactKind.PREVIEW_MANIFEST, ArtifactKind.EXPORT),
)
SIGNING = "signing"  # stage of a job that waits for its credentials


class Content(NamedTuple):
    """Stored content: its hash and its size in bytes."""

    sha256: str
    size: int


@dataclass(frozen=True)
class Submission:
    """Tenant of a new job, and the options that come with it.

    `cache` allows it the results of an earlier job: see :mod:`service.jobs.cache`.
    `signed` jobs have results with credentials. `copy_of` is the job whose places a copy has.
    `condition` is called in the transaction that records the job, with its id, after the job was added;
    an error in it rolls the transaction back.
    """

    tenant: str = DEFAULT_TENANT
    metadata: Mapping[str, str] = field(default_factory=dict)
    webhook: str | None = None
    cache: bool = False
    condition: Callable[[Session, str], None] = lambda _session, _job_id: None
    queue: Queue = Queue.SMALL
    priority: Priority = Priority.NORMAL
    signed: bool = False
    kind: JobKind = JobKind.WATERMARK
    copy_of: str | None = None


BY_DEFAULT = Submission()


class UnusableLedgerError(Exception):
    """The database answers, and cannot be the ledger of this version."""


class Ledger:
    """Jobs in a SQL database. Safe to share between threads; each call is one short transaction.

    Args:
        url: as SQLAlchemy writes it.
        retention: seconds after its end at which a job expires; 0: never.

    `identity` is the unique id of this ledger.

    Raises:
        OperationalError: the database does not answer.
        UnusableLedgerError: it is no ledger, one of a later version, or one that may not be changed.
    """

    def __init__(self, url: str, retention: float = 0) -> None:
        self._retention = retention
        self._engine = connect(url)
        self._session = sessionmaker(self._engine, expire_on_commit=False)
        try:
            with self._engine.begin() as connection:
                lock_keys(connection, {MIGRATION})
                migrate(connection)
                self.identity = str(connection.scalar(select(Identity.id)))
        except BaseException as error:
            self.close()
            if reason := _why_unusable(error):
                name = make_url(url).render_as_string(hide_password=True)
                raise UnusableLedgerError(
                    f"The database {name} cannot be the ledger: {reason}. "
                    "Name another one (MESHMARK_DATABASE_URL), or restore it from a copy."
                ) from error
            raise

    @property
    def sessions(self) -> sessionmaker[Session]:
        """Session factory, for the modules beside this one."""
        return self._session

    def close(self) -> None:
        """Close every connection."""
        self._engine.dispose()

    def ping(self) -> None:
        """Raise an error where the database does not answer, or accepts no writes, as on a full disk."""
        with self._engine.begin() as connection:
            connection.execute(update(Identity).values(id=Identity.id))

    def create(
        self,
        filename: str,
        parameters: dict[str, Any],
        contents: Mapping[ArtifactKind, Content],
        stored: Callable[[str], bool],
        submission: Submission = BY_DEFAULT,
        result_key: str | None = None,
        results: Mapping[ArtifactKind, Content] | None = None,
    ) -> Job:
        """Record a new queued job that refers to its inputs; `stored` tests whether the store has them.

        With `results`, those of an earlier job with the same `result_key`, it has succeeded from the beginning.

        Raises:
            MissingContentError: it does not; nothing is recorded. See :mod:`service.jobs.contents`.
        """
        contents = {**contents, **(results or {})}
        with self._session.begin() as session:
            lock_content(session, (item.sha256 for item in contents.values()), stored)
            moment = clock(session)
            expires = expiry(moment, self._retention)
            ended_at = {"finished_at": moment, "expires_at": expires, "purge_at": expires}
            done = {"state": JobState.SUCCEEDED, "progress": 1.0, "cached": True, **ended_at}
            job = Job(
                id=str(uuid.uuid4()),
                tenant_id=submission.tenant,
                kind=submission.kind,
                copy_of=submission.copy_of,
                result_key=result_key,
                queue=submission.queue,
                priority=submission.priority,
                correlation=correlation(),
                filename=filename,
                parameters=parameters,
                webhook=submission.webhook,
                created_at=moment,
                enqueued_at=moment,
                artifacts=[Artifact(kind=kind, sha256=item.sha256, size=item.size) for kind, item in contents.items()],
                metadata_entries=[MetadataEntry(key=key, value=value) for key, value in submission.metadata.items()],
                **(done if results else {"state": JobState.QUEUED}),
            )
            session.add(job)
            session.flush()
            add_stored(session, submission.tenant, sum(item.size for item in contents.values()))
            record(session, job.id, job.state, moment)
            submission.condition(session, job.id)
        JOBS_ACCEPTED.inc()
        ended(bool(results), JobState.SUCCEEDED)
        return job

    def copy(
        self,
        parent: Job,
        wanted: Sequence[copies.NewCopy],
        stored: Callable[[str], bool],
        webhook: str | None,
        condition: Callable[[Session, str], None],
    ) -> list[Job]:
        """Record copies of a job that has succeeded; `stored` tests whether the store has the files that they share,
        and `condition` is called with the id of the first, as that of a :class:`Submission`.

        Raises:
            MissingContentError: it does not, for the job's files are deleted; nothing is recorded.
        """
        shared = {item.sha256 for item in parent.artifacts if item.kind in copies.SHARED}
        with self._session.begin() as session:
            lock_content(session, shared, stored)
            made = self.add_copies(session, parent, wanted, clock(session), webhook)
            condition(session, made[0].id)
        JOBS_ACCEPTED.inc(len(made))
        return made

    def add_copies(
        self, session: Session, parent: Job, wanted: Sequence[copies.NewCopy], moment: datetime, webhook: str | None
    ) -> list[Job]:
        """Record copies of a job in a transaction: held back, or, where it has succeeded, let go at once. The content
        of its files is locked, and the job itself where it has not ended."""
        made = copies.add(session, parent, wanted, moment, webhook)
        if parent.state is JobState.SUCCEEDED:
            done = {"progress": 1.0, **self._finished(moment)}
            let_go(session, parent, [copy.id for copy in made], moment, done)
        return made

    def get(self, job_id: str, tenant: str = DEFAULT_TENANT) -> Job | None:
        """Current row of a tenant's job; None where there is none, and where it is another tenant's."""
        with self._session() as session:
            return session.scalar(select(Job).where(Job.id == job_id, Job.tenant_id == tenant))

    def claim(self, job_id: str, lease_seconds: float) -> Job | None:
        """Claim a queued job: start it, with a new lease; None where it is not (or no longer) there to be claimed."""
        with self._session.begin() as session:
            moment = clock(session)
            claimed = move(
                session,
                job_id,
                (Job.state == JobState.QUEUED, ~Job.held),
                JobState.RUNNING,
                moment,
                stage=None,
                progress=0.0,
                started_at=moment,
                attempts=Job.attempts + 1,
                lease_token=Job.lease_token + 1,
                lease_expires_at=moment + timedelta(seconds=lease_seconds),
            )
            return session.get(Job, job_id) if claimed else None

    def heartbeat(self, lease: Lease, lease_seconds: float, stage: str | None, progress: float) -> bool:
        """Renew the lease and record stage and progress; False when the lease is void."""
        with self._session.begin() as session:
            moment = clock(session)
            until = moment + timedelta(seconds=lease_seconds)
            values = {"lease_expires_at": until, "stage": stage, "progress": progress}
            if change(session, (*under(lease), Job.stage.is_not_distinct_from(stage)), **values):
                return True
            if not change(session, under(lease), **values):
                return False
            record(session, lease.job_id, "stage", moment)
            return True

    def publish(self, lease: Lease, kind: ArtifactKind, content: Content, stored: Callable[[str], bool]) -> bool:
        """Refer to an output, in place of an earlier attempt's; False when the lease is void.

        Raises:
            MissingContentError: `stored` says that the store does not have it; nothing is recorded.
        """
        with self._session.begin() as session:
            lock_content(session, {content.sha256}, stored)
            if not lock(session, under(lease)):
                return False
            before = session.get(Artifact, (lease.job_id, kind))
            more = content.size - (before.size if before else 0)
            session.merge(Artifact(job_id=lease.job_id, kind=kind, sha256=content.sha256, size=content.size))
            session.flush()
            add_stored(session, tenant_of(session, lease.job_id), more)
            return True

    def hand_over(self, lease: Lease) -> bool:
        """Give a job whose results are complete to the signers (:mod:`service.jobs.signing`), with no lease that could
        expire; False when the lease is void."""
        with self._session.begin() as session:
            moment = clock(session)
            values = {"stage": SIGNING, "lease_token": Job.lease_token + 1, "lease_expires_at": None, "sign_at": moment}
            if not change(session, under(lease), **values):
                return False
            record(session, lease.job_id, "stage", moment)
            return True

    def succeed(self, lease: Lease) -> bool:
        """running -> succeeded; False when the lease is void."""
        with self._session.begin() as session:
            moment = clock(session)
            values = {"progress": 1.0, **self._finished(moment)}
            done = move(session, lease.job_id, under(lease), JobState.SUCCEEDED, moment, **values)
        return ended(done, JobState.SUCCEEDED)

    def fail(self, lease: Lease, error: MeshmarkError) -> bool:
        """running -> failed; False when the lease is void."""
        with self._session.begin() as session:
            moment = clock(session)
            values = self._finished(moment, error)
            done = move(session, lease.job_id, under(lease), JobState.FAILED, moment, **values)
        return ended(done, JobState.FAILED, error.code)

    def release(self, lease: Lease) -> bool:
        """running -> queued without counting the attempt, for a worker that stops; False when the lease is void."""
        with self._session.begin() as session:
            moment = clock(session)
            values = {"attempts": Job.attempts - 1, **_queued(moment)}
            return move(session, lease.job_id, under(lease), JobState.QUEUED, moment, **values)

    def cancel(self, job_id: str, tenant: str = DEFAULT_TENANT) -> bool:
        """queued or running -> canceled; False when the job had already ended, or is not the tenant's."""
        condition = (Job.tenant_id == tenant, Job.state.in_(ACTIVE))
        with self._session.begin() as session:
            moment = clock(session)
            done = move(session, job_id, condition, JobState.CANCELED, moment, **self._finished(moment))
        return ended(done, JobState.CANCELED)

    def drop_outputs(self, lease: Lease) -> set[str]:
        """Forget what an earlier attempt published; returns the hashes: other jobs may have the same."""
        with self._session.begin() as session:
            if not lock(session, under(lease)):
                return set()
            return drop_files(session, lease.job_id, Artifact.kind.in_(OUTPUTS))

    def recover(self, max_attempts: int, error: MeshmarkError) -> tuple[list[str], list[str]]:
        """Requeue or fail running jobs whose leases have expired: (requeued ids, failed ids)."""
        requeued: list[str] = []
        failed: list[str] = []
        with self._session.begin() as session:
            moment = clock(session)
            silent = select(Job).where(Job.state == JobState.RUNNING, Job.lease_expires_at < moment)
            for job in session.scalars(silent.with_for_update(skip_locked=True)).all():
                # SQLite locks no row that is only read: there a heartbeat or another sweeper may have come since.
                condition = (*under(job.lease), Job.lease_expires_at < moment)
                again = job.attempts < max_attempts
                state = JobState.QUEUED if again else JobState.FAILED
                values = _queued(moment) if again else self._finished(moment, error)
                if move(session, job.id, condition, state, moment, **values):
                    (requeued if again else failed).append(job.id)
        for _ in failed:
            ended(True, JobState.FAILED, error.code)
        return requeued, failed

    def waiting(self, seconds: float, queue: Queue = Queue.SMALL, limit: int = 1000) -> list[str]:
        """Queued jobs that were not announced for so many seconds. They count as announced now, so announce them."""
        with self._session.begin() as session:
            moment = clock(session)
            silent = (
                Job.state == JobState.QUEUED,
                Job.queue == queue,
                ~Job.held,
                Job.enqueued_at < moment - timedelta(seconds=seconds),
            )
            free = select(Job.id).where(*silent).limit(limit).with_for_update(skip_locked=True)
            announced = update(Job).where(Job.id.in_(free), *silent).values(enqueued_at=moment).returning(Job.id)
            return list(session.scalars(announced))

    def running(self) -> set[Lease]:
        """Leases held now."""
        with self._session() as session:
            rows = session.execute(select(Job.id, Job.lease_token).where(Job.state == JobState.RUNNING))
            return {Lease(job_id, token) for job_id, token in rows}

    def _finished(self, moment: datetime, error: MeshmarkError | None = None) -> dict[str, Any]:
        expires = expiry_of_ended(moment, self._retention)
        values: dict[str, Any] = {
            "stage": None,
            "finished_at": moment,
            "lease_expires_at": None,
            "sign_at": None,
            "expires_at": expires,
            "purge_at": expires,
        }
        if error:
            values |= {"error_code": error.code.value, "error_message": error.message, "error_remedy": error.remedy}
        return values


def _why_unusable(error: BaseException) -> str | None:
    """Reason why the database cannot be the ledger; None for an outage, or an error of another kind."""
    if isinstance(error, NewerSchemaError):
        return f"it is of a later version of Meshmark, or another program's (schema {error})"
    if isinstance(error, DatabaseError) and not isinstance(error, OperationalError):
        return " ".join(str(error.orig).split())
    return None


def _queued(moment: datetime) -> dict[str, Any]:
    return {"stage": None, "progress": 0.0, "lease_expires_at": None, "enqueued_at": moment}
