"""What a webhook says: Standard Webhooks, "Payload structure"."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Self

from service.jobs.events import rfc3339
from service.jobs.models import EventType, JobEvent


@dataclass(frozen=True)
class Message:
    """One event as it is sent: the same id and the same bytes at every attempt and to every endpoint."""

    id: str
    body: bytes

    @classmethod
    def about(cls, event: JobEvent) -> Self:
        """The message about an event. Its id is as hard to guess as that of the job."""
        identifier = f"msg_{event.job_id.replace('-', '')}_{event.number}"
        return cls.of(identifier, event.type, event.created_at, event.data)

    @classmethod
    def of(cls, identifier: str, event: EventType, happened_at: datetime, job: Mapping[str, Any]) -> Self:
        """A message about what happened to a job, shown as in :func:`service.jobs.events.snapshot`.

        Raises:
            ValueError: JSON cannot say it.
        """
        content = {"type": event, "timestamp": rfc3339(happened_at), "data": job}
        body = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
        return cls(identifier, body)
