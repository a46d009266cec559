"""Retry schedule of webhooks: Standard Webhooks, "Deliverability and reliability"."""

from datetime import UTC, datetime, timedelta
from email.utils import parsedate_to_datetime

# Backoff before each attempt; the first comes at once, the last some three days after it.
DELAYS = tuple(
    timedelta(seconds=seconds) for seconds in (0, 5, 300, 1800, 7200, 18_000, 36_000, 50_400, 72_000, 86_400)
)
LONGEST_RETRY_AFTER = timedelta(days=1)  # beyond it, a receiver's Retry-After is cut
JITTER = 0.2  # largest share by which a wait is lengthened, so that retries of one outage are spread


def next_attempt(attempts: int, failed_at: datetime, draw: float, retry_after: timedelta | None) -> datetime | None:
    """Time of the next attempt, or None where this was the last one.

    Args:
        attempts: number of attempts made, 1 or more.
        failed_at: time at which the latest one failed.
        draw: a random number, 0 to 1.
        retry_after: wait that the receiver asked for: it lengthens waits, up to a day, and never shortens them.
    """
    if attempts >= len(DELAYS):
        return None
    asked = min(retry_after or timedelta(0), LONGEST_RETRY_AFTER)
    return failed_at + max(DELAYS[attempts], asked) * (1 + JITTER * draw)


def parse_retry_after(value: str | None, now: datetime) -> timedelta | None:
    """Wait that a Retry-After header asks for (RFC 9110, 10.2.3), or None where it cannot be read."""
    value = (value or "").strip()
    if value.isascii() and value.isdigit():
        return timedelta(seconds=min(float(value), LONGEST_RETRY_AFTER.total_seconds()))
    try:
        date = parsedate_to_datetime(value)
    except (ValueError, OverflowError):
        return None
    return max(date.replace(tzinfo=date.tzinfo or UTC) - now, timedelta(0))
