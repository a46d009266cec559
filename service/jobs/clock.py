"""What time it is."""

from datetime import UTC, datetime

from sqlalchemy import DateTime, func, select
from sqlalchemy.orm import Session


def now() -> datetime:
    """The present moment by this machine's clock, UTC."""
    return datetime.now(UTC)


def clock(session: Session) -> datetime:
    """The present moment by the clock of the database, UTC: for what several machines compare.

    Those of machines differ, by more than a lease perhaps. SQLite has none but that of its one machine.
    """
    if session.get_bind().dialect.name == "sqlite":
        return now()
    return session.scalars(select(func.clock_timestamp(type_=DateTime(timezone=True)))).one().astimezone(UTC)
