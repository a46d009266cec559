"""When a webhook that failed is sent again: Standard Webhooks, "Deliverability and reliability"."""

from datetime import UTC, datetime, timedelta
from email.utils import parsedate_to_datetime

# The wait before each attempt; the first comes at once, the last some three days after it.
DELAYS = tuple(
    timedelta(seconds=seconds) for seconds in (0, 5, 300, 1800, 7200, 18_000, 36_000, 50_400, 72_000, 86_400)
)
LONGEST_RETRY_AFTER = timedelta(days=1)
JITTER = 0.2  # the most by which a wait is lengthened, so that what failed together does not come back together


def next_attempt(attempts: int, failed_at: datetime, draw: float, retry_after: timedelta | None) -> datetime | None:
    """When to try again, or None when that was the last time.

    Args:
        attempts: how many were made, 1 or more.
        failed_at: when the latest one failed.
        draw: a random number, 0 to 1.
        retry_after: what the receiver asked for: waits are lengthened by it, up to a day, never shortened.
    """
    if attempts >= len(DELAYS):
        return None
    asked = min(retry_after or timedelta(0), LONGEST_RETRY_AFTER)
    return failed_at + max(DELAYS[attempts], asked) * (1 + JITTER * draw)


def parse_retry_after(value: str | None, now: datetime) -> timedelta | None:
    """The wait that a Retry-After header asks for (RFC 9110, 10.2.3), or None where it cannot be read."""
    value = (value or "").strip()
    if value.isascii() and value.isdigit():
        return timedelta(seconds=min(float(value), LONGEST_RETRY_AFTER.total_seconds()))
    try:
        date = parsedate_to_datetime(value)
    except (ValueError, OverflowError):
        return None
    return max(date.replace(tzinfo=date.tzinfo or UTC) - now, timedelta(0))
