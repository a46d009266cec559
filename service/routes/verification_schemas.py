"""Response models of the verification routes."""

from typing import Annotated, Self

from fastapi import Request
from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from core.verify.parameters import VerificationParameters
from service.jobs.models import PUBLIC_TENANT, ArtifactKind, Job
from service.routes.schemas import AnyJobView, common

EXAMPLE: JsonDict = {
    "id": "0b9d6a52-1f0e-4c57-8c39-7e1f0c2d9a11",
    "state": "succeeded",
    "stage": None,
    "progress": 1.0,
    "created_at": "2026-01-31T12:00:00.000000Z",
    "started_at": "2026-01-31T12:00:00.200000Z",
    "finished_at": "2026-01-31T12:00:11.400000Z",
    "expires_at": None,
    "attempts": 1,
    "input": None,
    "metadata": {"listing": "A-0815"},
    "webhook": None,
    "priority": "normal",
    "error": None,
    "parameters": {"texts": ["SAMPLE"], "keep": False},
    "links": {
        "self": "/v1/verifications/0b9d6a52-1f0e-4c57-8c39-7e1f0c2d9a11",
        "events": "/v1/verifications/0b9d6a52-1f0e-4c57-8c39-7e1f0c2d9a11/events",
        "report": "/v1/verifications/0b9d6a52-1f0e-4c57-8c39-7e1f0c2d9a11/report",
        "evidence": "/v1/verifications/0b9d6a52-1f0e-4c57-8c39-7e1f0c2d9a11/evidence",
    },
}


class VerificationLinks(BaseModel):
    """Where the verification's parts are; null until they exist, and once they are gone."""

    self: str
    events: Annotated[str | None, Field(description="Null without an API key, which they need.")]
    report: str | None
    evidence: str | None


class VerificationView(AnyJobView):
    """A verification of a suspect file, which is its `input` until the verification ends, and after it if kept."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})

    parameters: Annotated[
        VerificationParameters | None,
        Field(description="As you sent them, with the texts that are looked for; null once the job is deleted."),
    ]
    links: VerificationLinks

    @classmethod
    def of(cls, job: Job, url: str) -> Self:
        """Response model of a verification; `url` is its own."""
        parts = {
            kind.value: f"{url}/{kind}" if job.artifact(kind) else None
            for kind in (ArtifactKind.REPORT, ArtifactKind.EVIDENCE)
        }
        followed = None if job.tenant_id == PUBLIC_TENANT else f"{url}/events"
        return cls(
            **common(job),
            parameters=None if job.erased else VerificationParameters.model_validate(job.parameters),
            links=VerificationLinks(self=url, events=followed, **parts),
        )


class VerificationPage(BaseModel):
    """Some of the verifications there are, newest first."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"items": [EXAMPLE], "next": None}]})

    items: list[VerificationView]
    next: Annotated[str | None, Field(description="Where the list goes on; null: this is its end.")]


def view(request: Request, job: Job) -> VerificationView:
    """Response model of a verification."""
    return VerificationView.of(job, request.app.url_path_for("read_verification", job_id=job.id))
