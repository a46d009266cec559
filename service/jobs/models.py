"""The ledger's tables."""

from datetime import UTC, datetime
from enum import IntEnum, StrEnum
from typing import Any, Literal, NamedTuple

from sqlalchemy import (
    JSON,
    BigInteger,
    DateTime,
    Dialect,
    Enum,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    String,
    TypeDecorator,
    false,
    text,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

BIG = BigInteger().with_variant(Integer, "sqlite")  # bytes
DEFAULT_TENANT = "default"  # the owner of all jobs of a service without keys
PUBLIC_TENANT = "@public"  # the owner of verifications without a key; no name that a tenant may have


class JobKind(StrEnum):
    """Kind of work that a job is."""

    WATERMARK = "watermark"
    VERIFICATION = "verification"
    CONVERSION = "conversion"


class JobState(StrEnum):
    """Where a job stands; the last four are terminal, and only a succeeded job can still become `expired`."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"
    EXPIRED = "expired"


class EventType(StrEnum):
    """What can happen to a job: it comes into a state, or its work into another stage."""

    QUEUED = "watermark.queued"
    RUNNING = "watermark.running"
    STAGE = "watermark.stage"
    SUCCEEDED = "watermark.succeeded"
    FAILED = "watermark.failed"
    CANCELED = "watermark.canceled"
    EXPIRED = "watermark.expired"
    VERIFICATION_QUEUED = "verification.queued"
    VERIFICATION_RUNNING = "verification.running"
    VERIFICATION_STAGE = "verification.stage"
    VERIFICATION_SUCCEEDED = "verification.succeeded"
    VERIFICATION_FAILED = "verification.failed"
    VERIFICATION_CANCELED = "verification.canceled"
    VERIFICATION_EXPIRED = "verification.expired"
    CONVERSION_QUEUED = "conversion.queued"
    CONVERSION_RUNNING = "conversion.running"
    CONVERSION_STAGE = "conversion.stage"
    CONVERSION_SUCCEEDED = "conversion.succeeded"
    CONVERSION_FAILED = "conversion.failed"
    CONVERSION_CANCELED = "conversion.canceled"
    CONVERSION_EXPIRED = "conversion.expired"

    @classmethod
    def of(cls, kind: JobKind, change: "Change") -> "EventType":
        """Event type of a change to a job of some kind."""
        return cls(f"{kind}.{change}")


Change = JobState | Literal["stage"]  # of a job: into a state, or into another stage of its work


class DeliveryState(StrEnum):
    """Where a webhook stands; an exhausted one was not delivered, and is not tried again unless asked for."""

    PENDING = "pending"
    DELIVERED = "delivered"
    EXHAUSTED = "exhausted"


class DisabledReason(StrEnum):
    """Why an endpoint is sent nothing."""

    REQUESTED = "requested"
    GONE = "gone"  # it answered 410


class Queue(StrEnum):
    """Queue of a job: for any worker, for one with room for large assets, for one with a GPU."""

    SMALL = "small"
    LARGE = "large"
    GPU = "gpu"


class Priority(IntEnum):
    """Priority among a tenant's own waiting jobs; the lowest number goes first."""

    HIGH = 0
    NORMAL = 1
    LOW = 2


class ArtifactKind(StrEnum):
    """Role of a stored file in its job."""

    INPUT = "input"
    TEXTS = "texts"  # those of a job's copies, which its places are to have room for
    PLACEMENT = "placement"  # of a copy: the plan of its job
    FONT = "font"
    LOGO = "logo"
    MODEL = "model"
    PREVIEW_MODEL = "preview_model"
    PLAN = "plan"
    REPORT = "report"
    PREVIEW = "preview"
    TURNTABLE = "turntable"
    POSTER = "poster"
    EXPLANATION = "explanation"
    LAYERS = "layers"
    CREDENTIALS = "credentials"
    PREVIEW_MANIFEST = "preview_manifest"
    EXPORT = "export"
    EVIDENCE = "evidence"
    ORIGINAL = "original"
    MARKED = "marked"
    SIDECAR = "sidecar"


# Files that a verification compares: the suspect, an original, the report of the job that marked this, credentials.
COMPARED = (ArtifactKind.INPUT, ArtifactKind.ORIGINAL, ArtifactKind.MARKED, ArtifactKind.SIDECAR)


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


def _words(enumeration: type[StrEnum], length: int = 16) -> Enum:
    """A text column of an enumeration's values: a new value needs no migration, as a native type's would."""
    return Enum(enumeration, native_enum=False, length=length, values_callable=lambda members: [*map(str, members)])


def _only(condition: str) -> dict[str, Any]:
    """Options of a partial index: its condition."""
    return {"sqlite_where": text(condition), "postgresql_where": text(condition)}


class Base(DeclarativeBase):
    """Carries the metadata of all tables."""

    type_annotation_map = {  # noqa: RUF012
        datetime: UtcDateTime,
        dict[str, Any]: JSON,
        list[str]: JSON,
        JobKind: _words(JobKind),
        JobState: _words(JobState),
        Queue: _words(Queue),
        ArtifactKind: _words(ArtifactKind),
        EventType: _words(EventType, 32),
        DeliveryState: _words(DeliveryState),
        DisabledReason: _words(DisabledReason),
    }


class Identity(Base):
    """Unique id of this ledger, in a single row; see :mod:`service.jobs.ownership`."""

    __tablename__ = "ledger_identity"

    id: Mapped[str] = mapped_column(String(36), primary_key=True)


class Tenant(Base):
    """Tenant: the owner of jobs and API keys."""

    __tablename__ = "tenants"

    id: Mapped[str] = mapped_column(String(63), primary_key=True)
    created_at: Mapped[datetime]
    stored_bytes: Mapped[int] = mapped_column(BIG, default=0, server_default="0")  # see service.jobs.quota


class ApiKey(Base):
    """API key of a tenant's client, checked with each request; see :mod:`service.jobs.tenants`."""

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
    """Job: its request, its state and its results."""

    __tablename__ = "jobs"
    __table_args__ = (
        Index("ix_jobs_state_enqueued_at", "state", "enqueued_at"),
        Index("ix_jobs_tenant_id_state", "tenant_id", "state"),
        Index("ix_jobs_tenant_id_kind_created_at_id", "tenant_id", "kind", "created_at", "id"),
        Index("ix_jobs_tenant_id_result_key", "tenant_id", "result_key"),
        Index(
            "ix_jobs_state_queue_tenant_id_priority_created_at", "state", "queue", "tenant_id", "priority", "created_at"
        ),
        Index("ix_jobs_queue_tenant_id_started_at", "queue", "tenant_id", "started_at"),
        Index("ix_jobs_state_finished_at", "state", "finished_at"),
        Index("ix_jobs_sign_at", "sign_at", **_only("sign_at IS NOT NULL")),
        Index("ix_jobs_copy_of_created_at_id", "copy_of", "created_at", "id", **_only("copy_of IS NOT NULL")),
    )

    id: Mapped[str] = mapped_column(String(36), primary_key=True)
    tenant_id: Mapped[str] = mapped_column(String(63), server_default=DEFAULT_TENANT)  # never changes
    kind: Mapped[JobKind] = mapped_column(default=JobKind.WATERMARK, server_default=JobKind.WATERMARK)
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
    result_key: Mapped[str | None] = mapped_column(String(64))  # see service.jobs.cache
    cached: Mapped[bool] = mapped_column(default=False, server_default=false())
    attempts: Mapped[int] = mapped_column(default=0)
    lease_token: Mapped[int] = mapped_column(default=0)
    lease_expires_at: Mapped[datetime | None]
    sign_at: Mapped[datetime | None]  # when a signer may take it next: see service.jobs.signing
    error_code: Mapped[str | None] = mapped_column(String(64))
    error_message: Mapped[str | None]
    error_remedy: Mapped[str | None]
    correlation: Mapped[dict[str, Any]] = mapped_column(default=dict, server_default="{}")  # see service.correlation
    webhook: Mapped[str | None] = mapped_column(String(2048))  # URL that is notified when this job ends
    event_count: Mapped[int] = mapped_column(default=0, server_default="0")  # the number of its latest event
    erased: Mapped[bool] = mapped_column(default=False, server_default=false())  # its client's data is erased
    copy_of: Mapped[str | None] = mapped_column(String(36))  # see service.jobs.copies; that job may be gone
    held: Mapped[bool] = mapped_column(default=False, server_default=false())  # until that job has succeeded
    artifacts: Mapped[list["Artifact"]] = relationship(lazy="selectin", order_by="Artifact.kind")
    metadata_entries: Mapped[list["MetadataEntry"]] = relationship(lazy="selectin", order_by="MetadataEntry.key")

    @property
    def keeps_input(self) -> bool:
        """True where its inputs outlive its end: those of a verification do only where that was asked for, those of a
        conversion never."""
        return self.kind is JobKind.WATERMARK or bool(self.parameters.get("keep"))

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
    size: Mapped[int] = mapped_column(BIG)


class MetadataEntry(Base):
    """A name and a value that a client noted about a job; rows of their own, so that jobs are found by them."""

    __tablename__ = "job_metadata"
    __table_args__ = (Index("ix_job_metadata_key_value", "key", "value"),)

    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    key: Mapped[str] = mapped_column(String(40), primary_key=True)
    value: Mapped[str] = mapped_column(String(256))


class JobEvent(Base):
    """Event of a job, numbered from 1 in the job's own order; see :mod:`service.jobs.events`."""

    __tablename__ = "job_events"

    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    type: Mapped[EventType]
    data: Mapped[dict[str, Any]]  # the job as it stood then
    created_at: Mapped[datetime] = mapped_column(index=True)


class WebhookEndpoint(Base):
    """Webhook endpoint of a tenant; see :mod:`service.webhooks.endpoints`.

    Its secrets are stored as :mod:`service.webhooks.vault` seals them: signing needs them in clear.
    """

    __tablename__ = "webhook_endpoints"

    id: Mapped[str] = mapped_column(String(36), primary_key=True)
    tenant_id: Mapped[str] = mapped_column(String(63), index=True)
    url: Mapped[str | None] = mapped_column(String(2048))  # None: the webhooks that jobs name themselves
    events: Mapped[list[str]]
    secret: Mapped[str] = mapped_column(String(255))
    former_secret: Mapped[str | None] = mapped_column(String(255))
    former_secret_until: Mapped[datetime | None]
    disabled_reason: Mapped[DisabledReason | None]
    created_at: Mapped[datetime]


class WebhookDelivery(Base):
    """Delivery of an event to an endpoint; see :mod:`service.webhooks.deliveries`."""

    __tablename__ = "webhook_deliveries"
    __table_args__ = (
        ForeignKeyConstraint(
            ["job_id", "event_number"], ["job_events.job_id", "job_events.number"], ondelete="CASCADE"
        ),
        Index("ix_webhook_deliveries_job_id_event_number", "job_id", "event_number"),
        Index(
            "ix_webhook_deliveries_waiting",
            "tenant_id",
            "due_at",
            **_only("state = 'pending' AND announced_at IS NULL"),
        ),
        Index(
            "ix_webhook_deliveries_under_way", "tenant_id", **_only("state = 'pending' AND announced_at IS NOT NULL")
        ),
        Index("ix_webhook_deliveries_endpoint_id_created_at_id", "endpoint_id", "created_at", "id"),
    )

    id: Mapped[str] = mapped_column(String(36), primary_key=True)
    endpoint_id: Mapped[str] = mapped_column(ForeignKey("webhook_endpoints.id", ondelete="CASCADE"))
    tenant_id: Mapped[str] = mapped_column(String(63), server_default=DEFAULT_TENANT)  # the endpoint's
    job_id: Mapped[str] = mapped_column(String(36))
    event_number: Mapped[int]
    url: Mapped[str | None] = mapped_column(String(2048))  # the job's own; None: the endpoint's
    state: Mapped[DeliveryState] = mapped_column(default=DeliveryState.PENDING)
    attempts: Mapped[int] = mapped_column(default=0)
    due_at: Mapped[datetime | None]  # of the next attempt; while one is made: when its worker counts as lost
    announced_at: Mapped[datetime | None]  # when its message was sent to the queue, for this attempt
    token: Mapped[int] = mapped_column(default=0)  # of the latest claim
    created_at: Mapped[datetime]
    endpoint: Mapped[WebhookEndpoint] = relationship(lazy="joined", innerjoin=True)
    event: Mapped[JobEvent] = relationship(lazy="joined", innerjoin=True)
    log: Mapped[list["WebhookAttempt"]] = relationship(lazy="selectin", order_by="WebhookAttempt.number")


# Pending deliveries, in the exact words of the partial indexes.
WAITING = (WebhookDelivery.state == text("'pending'"), WebhookDelivery.announced_at.is_(None))
UNDER_WAY = (WebhookDelivery.state == text("'pending'"), WebhookDelivery.announced_at.is_not(None))


class WebhookAttempt(Base):
    """Outcome of one attempt to deliver a webhook."""

    __tablename__ = "webhook_attempts"

    delivery_id: Mapped[str] = mapped_column(ForeignKey("webhook_deliveries.id", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    started_at: Mapped[datetime]
    status: Mapped[int | None]
    error: Mapped[str | None]
    snippet: Mapped[str]
    seconds: Mapped[float]


class JobSource(Base):
    """Address of an asset that a worker is to download; see :mod:`service.jobs.sources`."""

    __tablename__ = "job_sources"

    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)
    url: Mapped[str] = mapped_column(String(2048))


class Upload(Base):
    """Upload: an asset that a client sends ahead; see :mod:`service.jobs.uploads`."""

    __tablename__ = "uploads"
    __table_args__ = (Index("ix_uploads_tenant_id_expires_at", "tenant_id", "expires_at"),)

    id: Mapped[str] = mapped_column(String(36), primary_key=True)
    tenant_id: Mapped[str] = mapped_column(ForeignKey("tenants.id"))
    filename: Mapped[str] = mapped_column(String(255))
    size: Mapped[int] = mapped_column(BIG)
    sha256: Mapped[str | None] = mapped_column(String(64))  # as the client declares it
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime] = mapped_column(index=True)


class DroppedObject(Base):
    """A version of an object in a watched bucket, and its job; see :mod:`service.jobs.dropped`."""

    __tablename__ = "dropped_objects"
    __table_args__ = (
        Index("ix_dropped_objects_output_due_at", "output", "due_at"),
        Index("ix_dropped_objects_source_key", "source", "key"),
    )

    id: Mapped[str] = mapped_column(String(64), primary_key=True)
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), unique=True)
    source: Mapped[str] = mapped_column(String(63))
    key: Mapped[str] = mapped_column(String(1024))
    output: Mapped[str] = mapped_column(String(16))
    tries: Mapped[int] = mapped_column(default=0)
    due_at: Mapped[datetime]
    created_at: Mapped[datetime]


class IdempotencyKey(Base):
    """Idempotency key with its job, or its reservation; see :mod:`service.jobs.idempotency`."""

    __tablename__ = "idempotency_keys"

    tenant_id: Mapped[str] = mapped_column(String(63), primary_key=True)
    key: Mapped[str] = mapped_column(String(255), primary_key=True)
    fingerprint: Mapped[str] = mapped_column(String(64))
    token: Mapped[str] = mapped_column(String(36))
    job_id: Mapped[str | None] = mapped_column(ForeignKey("jobs.id", ondelete="CASCADE"), index=True)
    expires_at: Mapped[datetime] = mapped_column(index=True)
