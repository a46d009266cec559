"""Clocks: that of this machine, and that of the database."""

from datetime import UTC, datetime

from sqlalchemy import DateTime, func, select
from sqlalchemy.orm import Session


def now() -> datetime:
    """Current time by this machine's clock, UTC."""
    return datetime.now(UTC)


def clock(session: Session) -> datetime:
    """Current time by the database's clock, UTC: for times that several machines compare.

    The clocks of machines may differ by more than a lease. SQLite has none but that of its one machine.
    """
    if session.get_bind().dialect.name == "sqlite":
        return now()
    return session.scalars(select(func.clock_timestamp(type_=DateTime(timezone=True)))).one().astimezone(UTC)
