"""How the job ledger's database is reached."""

import sqlite3
import time
from pathlib import Path
from typing import Any

from sqlalchemy import create_engine, event, exc
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Engine, make_url
from sqlalchemy.orm import Session
from sqlalchemy.pool import PoolProxiedConnection, QueuePool

# What libpq is told, so that a server that vanished without a word is noticed. Seconds; the last in milliseconds.
PATIENCE = {"connect_timeout": 5, "keepalives_idle": 10, "keepalives_interval": 5, "tcp_user_timeout": 20_000}
BUSY = 10.0  # seconds to wait for another process's lock on a SQLite file
# The most connections of a process, opened when they are needed and kept: opening one costs more than most of what is
# asked for. Who gets none for so many seconds gives up.
POOL: dict[str, Any] = {"pool_size": 15, "max_overflow": 0, "pool_timeout": 10}
INSERT = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}


class Pool(QueuePool):
    """Connections that are kept. That none comes free is one more way in which a database does not answer."""

    def connect(self) -> PoolProxiedConnection:
        """A connection, once there is one.

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
            connect_args=PATIENCE,
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
    """An INSERT that knows what to do where the row is there already (ON CONFLICT), which is no standard SQL."""
    return INSERT[session.get_bind().dialect.name](table)
