from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from service.webhooks.schedule import next_attempt, parse_retry_after

NOW = datetime(2026, 1, 31, 12, 0, tzinfo=UTC)


def test_retries_follow_the_table_of_the_specification() -> None:
    """Its second column: hours, minutes and seconds since the first attempt."""
    at: datetime | None = NOW
    times = []
    attempts = 0
    while at:
        attempts += 1
        seconds = int((at - NOW).total_seconds())
        times.append(f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}")
        at = next_attempt(attempts, at, 0.0, None)
    assert times == [
        *("00:00:00", "00:00:05", "00:05:05", "00:35:05", "02:35:05"),
        *("07:35:05", "17:35:05", "31:35:05", "51:35:05", "75:35:05"),
    ]


def test_what_failed_together_does_not_come_back_together() -> None:
    first, last = next_attempt(3, NOW, 0.0, None), next_attempt(3, NOW, 1.0, None)
    assert first == NOW + timedelta(minutes=30)
    assert last == NOW + timedelta(minutes=36)


def test_a_receiver_may_ask_for_more_time_within_a_day_but_not_for_less() -> None:
    def wait(asked: timedelta) -> timedelta:
        at = next_attempt(1, NOW, 0.0, asked)
        assert at is not None
        return at - NOW

    assert wait(timedelta(minutes=3)) == timedelta(minutes=3)
    assert wait(timedelta(seconds=1)) == timedelta(seconds=5)
    assert wait(timedelta(days=400)) == timedelta(days=1)
    assert next_attempt(10, NOW, 0.0, timedelta(seconds=1)) is None


@given(st.integers(1, 12), st.floats(0, 1), st.none() | st.timedeltas(timedelta(0)))
def test_the_next_attempt_is_always_later_and_never_far(
    attempts: int, draw: float, retry_after: timedelta | None
) -> None:
    at = next_attempt(attempts, NOW, draw, retry_after)
    assert (at is None) == (attempts >= 10)
    if at:
        assert timedelta(seconds=5) <= at - NOW <= timedelta(days=1.2)


@pytest.mark.parametrize(
    ("value", "seconds"),
    [
        ("120", 120),
        (" 0 ", 0),
        ("9" * 5000, 86_400),
        ("Sat, 31 Jan 2026 12:02:00 GMT", 120),
        ("Saturday, 31-Jan-26 12:02:00 GMT", 120),
        ("Sat, 31 Jan 2026 11:00:00 GMT", 0),
        ("Sat, 31 Jan 2026 12:02:00 -0000", 120),
    ],
)
def test_retry_after_is_seconds_or_a_date(value: str, seconds: int) -> None:
    assert parse_retry_after(value, NOW) == timedelta(seconds=seconds)


@pytest.mark.parametrize("value", [None, "", "soon", "-5", "1.5", "0x10", "²", "Sat, 99 Foo 2026 12:00:00 GMT"])
def test_retry_after_that_cannot_be_read_counts_for_nothing(value: str | None) -> None:
    assert parse_retry_after(value, NOW) is None


@given(st.text() | st.from_regex(r"\A(Sat, )?[0-9]{1,12} Jan [0-9]{1,12} [0-9:]{0,12}( GMT| [+-][0-9]{1,9})?\Z"))
@example("Sat, 31 Jan 99999999999999999999 12:00:00 GMT")
@example("Mon, 01 Jan 0001 00:00:00 +2359")
def test_no_retry_after_does_harm(value: str) -> None:
    waited = parse_retry_after(value, NOW)
    assert waited is None or waited >= timedelta(0)
