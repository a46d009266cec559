"""The ledger's tables."""

from datetime import UTC, datetime
from enum import IntEnum, StrEnum
from typing import Any, NamedTuple

from sqlalchemy import JSON, BigInteger, DateTime, Dialect, Enum, ForeignKey, Index, Integer, String, TypeDecorator
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

DEFAULT_TENANT = "default"  # whose the jobs of a service without keys are


class JobState(StrEnum):
    """Where a job stands; the last four are terminal, and only a succeeded job can still become `expired`."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"
    EXPIRED = "expired"


class Queue(StrEnum):
    """Where a job waits: for any worker, for one with room for large assets, for one with a GPU."""

    SMALL = "small"
    LARGE = "large"
    GPU = "gpu"


class Priority(IntEnum):
    """Which of a tenant's waiting jobs goes first."""

    HIGH = 0
    NORMAL = 1
    LOW = 2


class ArtifactKind(StrEnum):
    """What a stored file is to its job."""

    INPUT = "input"
    FONT = "font"
    MODEL = "model"
    REPORT = "report"
    PREVIEW = "preview"


class Lease(NamedTuple):
    """The right to change a running job. Every claim draws a higher token, so an old lease changes nothing."""

    job_id: str
    token: int


class UtcDateTime(TypeDecorator[datetime]):
    """An aware UTC datetime; SQLite keeps no zone, so it is stored naive there and everywhere."""

    impl = DateTime
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:  # noqa: ARG002
        """UTC without its zone."""
        return value and value.astimezone(UTC).replace(tzinfo=None)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:  # noqa: ARG002
        """UTC with its zone."""
        return value and value.replace(tzinfo=UTC)


def _words(enumeration: type[StrEnum]) -> Enum:
    """A text column of an enumeration's values: a new value needs no migration, as a native type's would."""
    return Enum(enumeration, native_enum=False, length=16, values_callable=lambda members: [*map(str, members)])


class Base(DeclarativeBase):
    """Carries the metadata of all tables."""

    type_annotation_map = {  # noqa: RUF012
        datetime: UtcDateTime,
        dict[str, Any]: JSON,
        list[str]: JSON,
        JobState: _words(JobState),
        Queue: _words(Queue),
        ArtifactKind: _words(ArtifactKind),
    }


class Identity(Base):
    """The one row that tells this ledger from every other; see :mod:`service.jobs.ownership`."""

    __tablename__ = "ledger_identity"

    id: Mapped[str] = mapped_column(String(36), primary_key=True)


class Tenant(Base):
    """Whose jobs and keys there are."""

    __tablename__ = "tenants"

    id: Mapped[str] = mapped_column(String(63), primary_key=True)
    created_at: Mapped[datetime]


class ApiKey(Base):
    """What a client of a tenant shows with each request; see :mod:`service.jobs.tenants`."""

    __tablename__ = "api_keys"

    id: Mapped[str] = mapped_column(String(8), primary_key=True)
    tenant_id: Mapped[str] = mapped_column(ForeignKey("tenants.id"))
    name: Mapped[str] = mapped_column(String(100))
    secret_sha256: Mapped[str] = mapped_column(String(64))
    scopes: Mapped[list[str]]
    created_at: Mapped[datetime]
    last_used_at: Mapped[datetime | None]
    expires_at: Mapped[datetime | None]
    revoked_at: Mapped[datetime | None]
    spent_until: Mapped[float] = mapped_column(default=0.0)  # seconds since 1970: see service.jobs.limits


class Job(Base):
    """One watermarking request and what became of it."""

    __tablename__ = "jobs"
    __table_args__ = (
        Index("ix_jobs_state_enqueued_at", "state", "enqueued_at"),
        Index("ix_jobs_tenant_id_state", "tenant_id", "state"),
        Index("ix_jobs_tenant_id_created_at_id", "tenant_id", "created_at", "id"),
        Index(
            "ix_jobs_state_queue_tenant_id_priority_created_at", "state", "queue", "tenant_id", "priority", "created_at"
        ),
        Index("ix_jobs_queue_tenant_id_started_at", "queue", "tenant_id", "started_at"),
    )

    id: Mapped[str] = mapped_column(String(36), primary_key=True)
    tenant_id: Mapped[str] = mapped_column(String(63), server_default=DEFAULT_TENANT)  # never changes
    queue: Mapped[Queue] = mapped_column(default=Queue.SMALL, server_default=Queue.SMALL)
    priority: Mapped[int] = mapped_column(default=Priority.NORMAL, server_default=str(int(Priority.NORMAL)))
    state: Mapped[JobState] = mapped_column(default=JobState.QUEUED)
    stage: Mapped[str | None] = mapped_column(String(32))
    progress: Mapped[float] = mapped_column(default=0.0)
    filename: Mapped[str] = mapped_column(String(255))
    parameters: Mapped[dict[str, Any]]
    created_at: Mapped[datetime]
    enqueued_at: Mapped[datetime]
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]
    expires_at: Mapped[datetime | None]
    purge_at: Mapped[datetime | None] = mapped_column(index=True)  # as expires_at, until the files are deleted
    attempts: Mapped[int] = mapped_column(default=0)
    lease_token: Mapped[int] = mapped_column(default=0)
    lease_expires_at: Mapped[datetime | None]
    error_code: Mapped[str | None] = mapped_column(String(64))
    error_message: Mapped[str | None]
    error_remedy: Mapped[str | None]
    artifacts: Mapped[list["Artifact"]] = relationship(lazy="selectin", order_by="Artifact.kind")
    metadata_entries: Mapped[list["MetadataEntry"]] = relationship(lazy="selectin", order_by="MetadataEntry.key")

    @property
    def lease(self) -> Lease:
        """The lease of the claim that returned this row."""
        return Lease(self.id, self.lease_token)

    def artifact(self, kind: ArtifactKind) -> "Artifact | None":
        """This job's stored file of one kind, if there is one."""
        return next((artifact for artifact in self.artifacts if artifact.kind == kind), None)


class Artifact(Base):
    """A reference from a job to stored content; the content lives as long as one reference does."""

    __tablename__ = "artifacts"

    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    kind: Mapped[ArtifactKind] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(String(64), index=True)
    size: Mapped[int] = mapped_column(BigInteger().with_variant(Integer, "sqlite"))


class MetadataEntry(Base):
    """A name and a value that a client noted about a job; rows of their own, so that jobs are found by them."""

    __tablename__ = "job_metadata"
    __table_args__ = (Index("ix_job_metadata_key_value", "key", "value"),)

    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    key: Mapped[str] = mapped_column(String(40), primary_key=True)
    value: Mapped[str] = mapped_column(String(256))


class IdempotencyKey(Base):
    """Which job a request with a key made, or that one is about to; see :mod:`service.jobs.idempotency`."""

    __tablename__ = "idempotency_keys"

    tenant_id: Mapped[str] = mapped_column(String(63), primary_key=True)
    key: Mapped[str] = mapped_column(String(255), primary_key=True)
    fingerprint: Mapped[str] = mapped_column(String(64))
    token: Mapped[str] = mapped_column(String(36))
    job_id: Mapped[str | None] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"))
    expires_at: Mapped[datetime] = mapped_column(index=True)
