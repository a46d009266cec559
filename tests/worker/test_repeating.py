"""Periodic steps of a worker go on through every outage, and the log says so once."""

import threading

import pytest
from kombu.exceptions import OperationalError as BrokerError
from sqlalchemy.exc import OperationalError
from structlog.testing import capture_logs

from service.jobs.artifacts import StoreUnavailableError
from worker.repeating import repeatedly

AWAY = "what a thread needs does not answer; it tries again"
BACK = "what a thread needs answers again"


def outcome(*steps: Exception | None) -> list[tuple[str, str]]:
    """What is logged while a step ends in each of these ways."""
    stopping, left = threading.Event(), iter(steps)

    def step() -> None:
        try:
            error = next(left)
        except StopIteration:
            stopping.set()
            return
        if error:
            raise error

    with capture_logs() as logged:
        repeatedly("sweeper", step, 0.0, stopping).join()
    assert {entry["thread"] for entry in logged} <= {"sweeper"}
    assert not [entry for entry in logged if entry["event"] in (AWAY, BACK) and "exc_info" in entry]
    return [(entry["log_level"], entry["event"]) for entry in logged]


@pytest.mark.parametrize(
    "error",
    [StoreUnavailableError(), BrokerError("no"), OperationalError(None, None, Exception("no\nno")), OSError("full")],
    ids=lambda error: type(error).__name__,
)
def test_a_server_that_is_away_for_long_is_one_line_and_that_it_is_back_another(error: Exception) -> None:
    assert outcome(error, error, error, None, None) == [("warning", AWAY), ("info", BACK)]
    assert outcome(error, None, error) == [("warning", AWAY), ("info", BACK), ("warning", AWAY), ("info", BACK)]


def test_a_step_that_fails_for_another_reason_is_told_of_each_time_and_taken_again() -> None:
    assert outcome(ValueError(), ValueError(), None) == [("error", "a thread failed; it tries again")] * 2
