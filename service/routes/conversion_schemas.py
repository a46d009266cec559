"""Response model of the conversion routes."""

from typing import Annotated, Self

from fastapi import Request
from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict

from service.jobs.models import ArtifactKind, Job
from service.routes.schemas import AnyJobView, common

EXAMPLE: JsonDict = {
    "id": "d2a7c1de-7f40-4be4-9b43-5b0f6c2a1e07",
    "state": "succeeded",
    "stage": None,
    "progress": 1.0,
    "created_at": "2026-01-31T12:00:00.000000Z",
    "started_at": "2026-01-31T12:00:00.100000Z",
    "finished_at": "2026-01-31T12:00:00.600000Z",
    "expires_at": "2026-01-31T13:00:00.600000Z",
    "attempts": 1,
    "input": None,
    "metadata": {},
    "webhook": None,
    "priority": "high",
    "error": None,
    "links": {
        "self": "/v1/conversions/d2a7c1de-7f40-4be4-9b43-5b0f6c2a1e07",
        "model": "/v1/conversions/d2a7c1de-7f40-4be4-9b43-5b0f6c2a1e07/model",
    },
}


class ConversionLinks(BaseModel):
    """Where the conversion's parts are; null until they exist, and once they are gone."""

    self: str
    model: Annotated[str | None, Field(description="The asset as a plain GLB.")]


class ConversionView(AnyJobView):
    """A conversion of an asset, which is its `input` until the conversion ends."""

    model_config = ConfigDict(json_schema_extra={"examples": [EXAMPLE]})

    links: ConversionLinks

    @classmethod
    def of(cls, job: Job, url: str) -> Self:
        """Response model of a conversion; `url` is its own."""
        model = f"{url}/model" if job.artifact(ArtifactKind.MODEL) else None
        return cls(**common(job), links=ConversionLinks(self=url, model=model))


def view(request: Request, job: Job) -> ConversionView:
    """Response model of a conversion."""
    return ConversionView.of(job, request.app.url_path_for("read_conversion", job_id=job.id))
