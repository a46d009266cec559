"""What a webhook says: Standard Webhooks, "Payload structure"."""

import json
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, Self


class EventType(StrEnum):
    """What happened to a job: one for each state that it can end in."""

    SUCCEEDED = "watermark.succeeded"
    FAILED = "watermark.failed"
    CANCELED = "watermark.canceled"
    EXPIRED = "watermark.expired"


@dataclass(frozen=True)
class Message:
    """One event as it is sent: the same id and the same bytes at every attempt and to every endpoint."""

    id: str
    body: bytes

    @classmethod
    def of(cls, event: EventType, happened_at: datetime, job: Mapping[str, Any]) -> Self:
        """A new message about a job in the form in which the API shows it."""
        timestamp = happened_at.astimezone(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")
        content = {"type": event, "timestamp": timestamp, "data": job}
        body = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
        return cls(f"msg_{uuid.uuid4().hex}", body)
