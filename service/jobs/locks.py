"""Locks of keys in the ledger's database, for a transaction: they hold between machines."""

from collections.abc import Iterable

from sqlalchemy import Connection, text
from sqlalchemy.orm import Session

# First statement of a transaction that excludes all others with the same key. SQLite has one lock for all.
EXCLUSIVE = {"sqlite": text("BEGIN IMMEDIATE"), "postgresql": text("SELECT pg_advisory_xact_lock(:key)")}


def lock_keys(transaction: Connection | Session, keys: Iterable[int]) -> None:
    """Begin a transaction that excludes all others with one of these keys, until it commits."""
    dialect = transaction.get_bind().dialect.name if isinstance(transaction, Session) else transaction.dialect.name
    if dialect == "sqlite":
        transaction.execute(EXCLUSIVE[dialect])
        return
    for key in sorted(keys):  # in the same order everywhere, so that no two wait for each other
        transaction.execute(EXCLUSIVE[dialect], {"key": key})
