"""Payload of a webhook: Standard Webhooks, "Payload structure"."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Self

from service.jobs.events import rfc3339
from service.jobs.models import EventType, JobEvent


@dataclass(frozen=True)
class Message:
    """Event as it is sent: the same id and the same bytes at every attempt and to every endpoint."""

    id: str
    body: bytes

    @classmethod
    def about(cls, event: JobEvent) -> Self:
        """Message about an event. Its id is as hard to guess as that of the job."""
        identifier = f"msg_{event.job_id.replace('-', '')}_{event.number}"
        return cls.of(identifier, event.type, event.created_at, event.data)

    @classmethod
    def of(cls, identifier: str, event: EventType, happened_at: datetime, job: Mapping[str, Any]) -> Self:
        """Message about an event of a job, which is given as :func:`service.jobs.events.snapshot` does.

        Raises:
            ValueError: it cannot be written as JSON.
        """
        content = {"type": event, "timestamp": rfc3339(happened_at), "data": job}
        body = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
        return cls(identifier, body)
