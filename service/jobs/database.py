"""How the job ledger's database is reached."""

import sqlite3
import time
from pathlib import Path
from typing import Any

from sqlalchemy import create_engine, event
from sqlalchemy.engine import Engine, make_url

# What libpq is told, so that a server that vanished without a word is noticed. Seconds; the last in milliseconds.
PATIENCE = {"connect_timeout": 5, "keepalives_idle": 10, "keepalives_interval": 5, "tcp_user_timeout": 20_000}
BUSY = 10.0  # seconds to wait for another process's lock on a SQLite file


def connect(url: str) -> Engine:
    """An engine for a database, as SQLAlchemy writes its URL."""
    if make_url(url).get_backend_name() != "sqlite":
        # The locks of the ledger are reasoned for this level, whatever the server's own default is.
        return create_engine(
            url,
            pool_pre_ping=True,
            isolation_level="READ COMMITTED",
            connect_args=PATIENCE,
            hide_parameters=True,  # in error messages: they may be secrets, or addresses that hold a signature
        )
    if database := make_url(url).database:
        Path(database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(url, connect_args={"timeout": BUSY}, hide_parameters=True)

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
