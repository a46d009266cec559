import json
from datetime import datetime, timedelta, timezone

import pytest

from service.jobs.models import JobState
from service.webhooks.payload import EventType, Message

HAPPENED = datetime(2026, 1, 31, 13, 0, tzinfo=timezone(timedelta(hours=1)))


def test_a_message_says_what_happened_when_and_shows_the_job() -> None:
    job = {"id": "1", "state": "succeeded", "input": {"filename": "Löwe.glb"}, "error": None}
    message = Message.of(EventType.SUCCEEDED, HAPPENED, job)
    assert json.loads(message.body) == {
        "type": "watermark.succeeded",
        "timestamp": "2026-01-31T12:00:00.000000Z",
        "data": job,
    }
    assert list(json.loads(message.body)) == ["type", "timestamp", "data"]


def test_each_message_has_an_id_of_its_own_fit_for_signing() -> None:
    ids = {Message.of(EventType.FAILED, HAPPENED, {}).id for _ in range(100)}
    assert len(ids) == 100
    assert all(identifier.startswith("msg_") and "." not in identifier for identifier in ids)


def test_there_is_an_event_for_each_state_in_which_a_job_ends() -> None:
    ends = set(JobState) - {JobState.QUEUED, JobState.RUNNING}
    assert {f"watermark.{state}" for state in ends} == set(EventType)


def test_what_json_cannot_say_is_not_sent() -> None:
    with pytest.raises(ValueError, match="JSON"):
        Message.of(EventType.FAILED, HAPPENED, {"progress": float("nan")})
