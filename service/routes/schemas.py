"""Response models of the watermark routes."""

import re
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, Self, get_args

from fastapi import Request
from pydantic import AfterValidator, AwareDatetime, BaseModel, BeforeValidator, ConfigDict, Field
from pydantic.config import JsonDict

from core.parameters import Parameters
from service.errors import error_code, title
from service.jobs.ledger import OUTPUTS
from service.jobs.models import ArtifactKind, Job, JobState, Priority
from service.problems import PublishedCode

EXAMPLE: JsonDict = {
    "id": "6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11",
    "state": "running",
    "stage": "evaluating",
    "progress": 0.8,
    "created_at": "2026-01-31T12:00:00.000000Z",
    "started_at": "2026-01-31T12:00:00.200000Z",
    "finished_at": None,
    "expires_at": None,
    "attempts": 1,
    "cached": False,
    "input": {
        "filename": "lantern.glb",
        "size": 9563016,
        "sha256": "b94d27b9934d3e08a52e52d7da7dabfac484efe37a5380ee9088f7ace2efcde9",
    },
    "parameters": {"text": "SAMPLE", "seed": 7},
    "metadata": {"order": "4711"},
    "webhook": None,
    "priority": "normal",
    "error": None,
    "copy_of": None,
    "links": {
        "self": "/v1/watermarks/6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11",
        "events": "/v1/watermarks/6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11/events",
        "model": "/v1/watermarks/6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11/model",
        "preview_model": None,
        "export": None,
        "plan": None,
        "report": None,
        "preview": None,
        "turntable": None,
        "poster": None,
        "explanation": None,
        "layers": None,
        "credentials": None,
        "preview_manifest": None,
    },
}


DATE = re.compile(r"\d{4}-\d\d-\d\d")


def _utc(moment: datetime) -> datetime:
    try:
        return moment.astimezone(UTC)
    except OverflowError:  # in UTC, it is before the year 1 or after 9999
        raise ValueError("it is out of range") from None


def _rfc_3339(sent: object) -> object:
    if isinstance(sent, str) and not DATE.match(sent):  # pydantic would read seconds since 1970 too
        raise ValueError("it is not a time as in RFC 3339")
    return sent


Moment = Annotated[AwareDatetime, BeforeValidator(_rfc_3339), AfterValidator(_utc)]


PriorityName = Literal["high", "normal", "low"]  # in the order of Priority


class InputView(BaseModel):
    """The uploaded asset."""

    filename: str
    size: Annotated[int, Field(description="Bytes.")]
    sha256: str


class ErrorView(BaseModel):
    """Why a job failed."""

    code: PublishedCode
    title: str
    detail: Annotated[str, Field(description="What is wrong with this asset or this request.")]
    remedy: Annotated[str, Field(description="What to do about it.")]


class LinksView(BaseModel):
    """Where the job's parts are; null until they exist, and once they are gone."""

    self: str
    events: str
    model: str | None
    preview_model: str | None
    export: str | None
    plan: str | None
    report: str | None
    preview: str | None
    turntable: str | None
    poster: str | None
    explanation: str | None
    layers: str | None
    credentials: str | None
    preview_manifest: str | None


class AnyJobView(BaseModel):
    """Fields of a job of every kind."""

    id: str
    state: JobState
    stage: Annotated[str | None, Field(description="What a running job does at the moment.")]
    progress: Annotated[float, Field(ge=0, le=1, description="How much of the job is done; 1 once succeeded.")]
    created_at: datetime
    started_at: Annotated[datetime | None, Field(description="When the latest attempt began.")]
    finished_at: datetime | None
    expires_at: Annotated[
        datetime | None, Field(description="When the job's files are deleted; null: never, or not yet known.")
    ]
    attempts: Annotated[int, Field(description="How often the job was started.")]
    input: Annotated[InputView | None, Field(description="The uploaded asset; null once it is deleted.")]
    metadata: Annotated[dict[str, str], Field(description="What the client noted when it sent the asset.")]
    webhook: Annotated[str | None, Field(description="Where a webhook is sent when the job ends.")]
    priority: Annotated[PriorityName, Field(description="Which of your waiting jobs goes first.")]
    error: ErrorView | None


def common(job: Job) -> dict[str, Any]:
    """The fields of :class:`AnyJobView`."""
    source = job.artifact(ArtifactKind.INPUT)
    error = None
    if job.error_code is not None:
        code = error_code(job.error_code)
        error = ErrorView(code=code, title=title(code), detail=job.error_message or "", remedy=job.error_remedy or "")
    return {
        "id": job.id,
        "state": job.state,
        "stage": job.stage,
        "progress": round(job.progress, 3),
        "created_at": job.created_at,
        "started_at": job.started_at,
        "finished_at": job.finished_at,
        "expires_at": job.expires_at,
        "attempts": job.attempts,
        "input": InputView(filename=job.filename, size=source.size, sha256=source.sha256) if source else None,
        "metadata": {entry.key: entry.value for entry in job.metadata_entries},
        "webhook": job.webhook,
        "priority": get_args(PriorityName)[Priority(job.priority)],
        "error": error,
    }


class JobView(AnyJobView):
    """A watermarking job."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})

    cached: Annotated[bool, Field(description="Whether the results are those of an earlier job of yours.")]
    parameters: Annotated[Parameters | None, Field(description="As you sent them; null once the job is deleted.")]
    copy_of: Annotated[str | None, Field(description="The job whose places it has; null where it found its own.")]
    links: LinksView

    @classmethod
    def of(cls, job: Job, url: str) -> Self:
        """Response model of a job; `url` is the job's own."""
        return cls(
            **common(job),
            cached=job.cached,
            parameters=None if job.erased else Parameters.model_validate(job.parameters),
            copy_of=job.copy_of,
            links=links(job, url),
        )


def links(job: Job, url: str) -> LinksView:
    """Links to the parts of a job; `url` is the job's own."""
    kinds = [kind for kind in OUTPUTS if kind in LinksView.model_fields]
    parts = {kind.value: f"{url}/{kind}" if job.artifact(kind) else None for kind in kinds}
    return LinksView(self=url, events=f"{url}/events", **parts)


class JobPage(BaseModel):
    """Some of the jobs there are, newest first."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"items": [EXAMPLE], "next": "/v1/watermarks?limit=1&cursor=MjAyNi0wMS0zMVQ"}]}
    )

    items: list[JobView]
    next: Annotated[str | None, Field(description="Where the list goes on; null: this is its end.")]


def view(request: Request, job: Job) -> JobView:
    """Response model of a job."""
    return JobView.of(job, request.app.url_path_for("read_watermark", job_id=job.id))
