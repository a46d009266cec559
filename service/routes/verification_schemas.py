"""Response models of the verification routes."""

from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Self

from fastapi import Request
from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from core.verify.parameters import VerificationParameters
from service.jobs.models import PUBLIC_TENANT, ArtifactKind, Job
from service.jobs.owners import Owner
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


class OwnerJob(BaseModel):
    """A watermark job of yours."""

    id: str
    copy_of: Annotated[str | None, Field(description="The job that it is a copy of.")]
    created_at: datetime
    metadata: Annotated[dict[str, str], Field(description="What the client noted about it.")]
    link: Annotated[str, Field(description="The job itself.")]


class WatermarkRead(BaseModel):
    """A text of yours that was read on the file."""

    text: str
    likeness: Annotated[float, Field(ge=0, le=1, description="Ratio to the best reading, without case and spaces.")]
    readings: Annotated[int, Field(description="Marks that no other text of yours is more like.")]
    jobs: Annotated[list[OwnerJob], Field(description="The jobs that embossed it, the newest first, at most 20.")]


class WatermarksRead(BaseModel):
    """Texts of yours that were read on the file, the likeliest first, at most 20."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "items": [
                        {
                            "text": "ORDER-4711",
                            "likeness": 1.0,
                            "readings": 9,
                            "jobs": [
                                {
                                    "id": "0d3a9a4e-7f0b-4c1e-9f39-0d2b1a7c9d12",
                                    "copy_of": "6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11",
                                    "created_at": "2026-01-31T12:00:00.000000Z",
                                    "metadata": {"customer": "17"},
                                    "link": "/v1/watermarks/0d3a9a4e-7f0b-4c1e-9f39-0d2b1a7c9d12",
                                }
                            ],
                        }
                    ]
                }
            ]
        }
    )

    items: list[WatermarkRead]

    @classmethod
    def of(cls, request: Request, found: Sequence[Owner]) -> Self:
        """Response model of texts that were read."""
        items = [
            WatermarkRead(
                text=owner.text,
                likeness=round(owner.likeness, 4),
                readings=owner.readings,
                jobs=[
                    OwnerJob(
                        id=job.id,
                        copy_of=job.copy_of,
                        created_at=job.created_at,
                        metadata={entry.key: entry.value for entry in job.metadata_entries},
                        link=request.app.url_path_for("read_watermark", job_id=job.id),
                    )
                    for job in owner.jobs
                ],
            )
            for owner in found
        ]
        return cls(items=items)
