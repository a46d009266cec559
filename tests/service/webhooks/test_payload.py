import json
from datetime import datetime, timedelta, timezone

import pytest

from service.jobs.models import EventType, JobEvent
from service.webhooks.payload import Message

HAPPENED = datetime(2026, 1, 31, 13, 0, tzinfo=timezone(timedelta(hours=1)))


def test_a_message_says_what_happened_when_and_shows_the_job() -> None:
    job = {"id": "1", "state": "succeeded", "input": {"filename": "Löwe.glb"}, "error": None}
    message = Message.of("msg_1", EventType.SUCCEEDED, HAPPENED, job)
    assert json.loads(message.body) == {
        "type": "watermark.succeeded",
        "timestamp": "2026-01-31T12:00:00.000000Z",
        "data": job,
    }
    assert list(json.loads(message.body)) == ["type", "timestamp", "data"]


def test_an_event_gives_the_same_message_each_time_and_another_event_another_one() -> None:
    job_id = "6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11"
    first, second = (
        JobEvent(job_id=job_id, number=number, type=EventType.FAILED, data={"id": job_id}, created_at=HAPPENED)
        for number in (4, 5)
    )
    assert Message.about(first) == Message.about(first)
    assert Message.about(first).id == "msg_6f1c2f0e53a54f6e9f390d2b1a7c9d11_4"
    assert Message.about(second).id != Message.about(first).id
    assert json.loads(Message.about(first).body)["data"] == {"id": job_id}


def test_what_json_cannot_say_is_not_sent() -> None:
    with pytest.raises(ValueError, match="JSON"):
        Message.of("msg_1", EventType.FAILED, HAPPENED, {"progress": float("nan")})
