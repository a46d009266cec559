"""Connections to the job ledger's database."""

import sqlite3
import time
from pathlib import Path
from typing import Any

from sqlalchemy import create_engine, event, exc
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Engine, make_url
from sqlalchemy.orm import Session
from sqlalchemy.pool import PoolProxiedConnection, QueuePool

# Options of libpq that detect a server that vanished silently. Seconds; the last in milliseconds.
TIMEOUTS = {"connect_timeout": 5, "keepalives_idle": 10, "keepalives_interval": 5, "tcp_user_timeout": 20_000}
BUSY = 10.0  # seconds to wait for another process's lock on a SQLite file
# Connection pool of a process, filled on demand and kept: opening a connection costs more than most queries. Its
# time-out: seconds to wait for a free connection.
POOL: dict[str, Any] = {"pool_size": 15, "max_overflow": 0, "pool_timeout": 10}
INSERT = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}


class Pool(QueuePool):
    """Connection pool that reports its exhaustion as OperationalError, as any database that does not answer."""

    def connect(self) -> PoolProxiedConnection:
        """Connection, once one is free.

        Raises:
            OperationalError: there is none in time.
        """
        try:
            return super().connect()
        except exc.TimeoutError as error:
            raise exc.OperationalError(None, None, error) from error


def connect(url: str) -> Engine:
    """Connections to the database at a URL, as SQLAlchemy writes it; a folder for a SQLite file is made."""
    if make_url(url).get_backend_name() != "sqlite":
        # The locks of the ledger are reasoned for this level, whatever the server's own default is.
        return create_engine(
            url,
            pool_pre_ping=True,
            poolclass=Pool,
            **POOL,
            isolation_level="READ COMMITTED",
            connect_args=TIMEOUTS,
            hide_parameters=True,  # in error messages: they may be secrets, or addresses that hold a signature
        )
    if database := make_url(url).database:
        Path(database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(url, connect_args={"timeout": BUSY}, hide_parameters=True, poolclass=Pool, **POOL)

    @event.listens_for(engine, "connect")
    def _tune(connection: Any, _record: Any) -> None:
        connection.execute("PRAGMA foreign_keys=ON")
        deadline = time.monotonic() + BUSY
        while True:
            try:
                connection.execute("PRAGMA journal_mode=WAL")  # readers never wait for the writer
                return
            except sqlite3.OperationalError:  # the one statement that does not wait for another process's lock
                if time.monotonic() > deadline:
                    raise
            time.sleep(0.01)

    return engine


def insert_into(session: Session, table: Any) -> Any:
    """INSERT with the dialect's ON CONFLICT clause, which is not standard SQL."""
    return INSERT[session.get_bind().dialect.name](table)
