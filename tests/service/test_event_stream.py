import asyncio
from collections.abc import Sequence
from datetime import UTC, datetime

import pytest
from sqlalchemy.exc import OperationalError

from core.errors import MeshmarkError
from service import event_stream as module
from service.event_stream import Streams, as_text, event_stream, parse_last_event_id
from service.jobs.models import EventType, JobEvent
from tests.worker.waiting import PATIENCE


def event(number: int, kind: EventType, **data: object) -> JobEvent:
    return JobEvent(job_id="1", number=number, type=kind, data=data, created_at=datetime.now(UTC))


class Log:
    """A job's events, and an outage before some of the looks at them."""

    def __init__(self, *events: JobEvent, outages: int = 0) -> None:
        self.events = list(events)
        self.outages = outages

    def read(self, after: int) -> Sequence[JobEvent]:
        if self.outages:
            self.outages -= 1
            raise OperationalError("SELECT", {}, Exception("no connection"))
        return [event for event in self.events if event.number > after]


def received(log: Log, after: int = 0, most: int | None = None) -> list[bytes]:
    """What comes until the stream ends, or the first few chunks."""

    async def listen() -> list[bytes]:
        chunks: list[bytes] = []
        async for chunk in event_stream(log.read, after, asyncio.Event()):
            chunks.append(chunk)
            if len(chunks) == most:
                break
        return chunks

    return asyncio.run(asyncio.wait_for(listen(), PATIENCE))


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "POLL", 0.01)


def test_an_event_has_its_number_its_type_and_the_job_in_one_line() -> None:
    text = as_text(event(7, EventType.FAILED, id="1", error={"detail": "two\nlines \u2028 and ä"})).decode()
    lines = text.split("\n")
    assert lines[0] == "event: watermark.failed"
    assert lines[1] == 'data: {"id": "1", "error": {"detail": "two\\nlines \u2028 and ä"}}'
    assert lines[2:] == ["id: 7", "", ""]


def test_a_stream_ends_with_the_event_that_ends_the_job_and_what_came_after_it() -> None:
    log = Log(event(1, EventType.QUEUED), event(2, EventType.SUCCEEDED), event(3, EventType.EXPIRED))
    retry, *events = received(log)
    assert retry == b"retry: 1000\n\n"
    assert [text.split(b"\n")[0] for text in events] == [
        b"event: watermark.queued",
        b"event: watermark.succeeded",
        b"event: watermark.expired",
    ]
    assert received(log, after=2)[1:] == events[2:]


def test_silence_is_broken_by_comments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PING", 0.1)
    assert received(Log(event(1, EventType.QUEUED)), most=5)[2:] == [b": ping\n\n"] * 3


def test_a_stream_ends_after_a_while_so_that_its_client_shows_its_key_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LONGEST", 0.1)
    assert len(received(Log(event(1, EventType.QUEUED)))) == 2


def test_a_ledger_that_does_not_answer_for_a_while_delays_events_and_loses_none() -> None:
    log = Log(event(1, EventType.QUEUED), event(2, EventType.CANCELED), outages=3)
    assert len(received(log)) == 3


def test_a_place_is_free_again_whatever_ended_the_stream(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "STREAMS_PER_TENANT", 1)
    streams = Streams()
    with streams.place("acme"), streams.place("beta"):
        with pytest.raises(MeshmarkError, match="too_many_streams"), streams.place("acme"):
            raise AssertionError("there was none left")
        assert streams.count("acme") == 1
    with pytest.raises(KeyboardInterrupt), streams.place("acme"):
        raise KeyboardInterrupt
    assert streams.count("acme") == streams.count("beta") == 0


@pytest.mark.parametrize(("text", "number"), [(None, 0), ("", 0), ("0", 0), ("12", 12)])
def test_the_last_event_is_named_by_its_number(text: str | None, number: int) -> None:
    assert parse_last_event_id(text) == number


@pytest.mark.parametrize("text", ["-1", "1.5", "x", "\u0661", "1" * 10, "1\x00"])
def test_what_is_no_events_number_is_refused(text: str) -> None:
    with pytest.raises(MeshmarkError, match="invalid_request"):
        parse_last_event_id(text)


def test_all_tenants_together_have_so_many_places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "STREAMS", 2)
    streams = Streams()
    refused = pytest.raises(MeshmarkError, match="service_unavailable")
    with streams.place("acme"), streams.place("beta"), refused, streams.place("gamma"):
        pytest.fail("there is no place")
    with streams.place("acme"), streams.place("gamma"):
        assert (streams.count("beta"), streams.count("gamma")) == (0, 1)
