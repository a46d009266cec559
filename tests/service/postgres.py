"""A real PostgreSQL for the tests: on a free loopback port, in a folder of its own, gone afterwards."""

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import psycopg
import pytest

from tests.service.harness import free_port
from tests.worker.waiting import PATIENCE, wait_until

# What a crash of the machine would cost is no concern here, and speed is.
FAST = ["fsync=off", "synchronous_commit=off", "full_page_writes=off"]


class Postgres:
    """A server that may be stopped and started again, as any number of empty databases."""

    def __init__(self, programs: Path, folder: Path, user: str | None, durable: bool = False) -> None:
        self.port = free_port()
        self._settings = [] if durable else FAST
        self._programs, self._folder, self._user = programs, folder, user
        self._run("initdb", "--username=meshmark", "--auth=trust", "--no-sync", "--encoding=UTF8", "--no-locale")

    def start(self) -> None:
        """Start the server and wait until it answers."""
        settings = [
            *self._settings,
            "max_connections=200",
            f"port={self.port}",
            "listen_addresses=127.0.0.1",
            "unix_socket_directories=",
        ]
        self._process = subprocess.Popen(
            [self._programs / "postgres", "-D", self._folder, *(f"-c{setting}" for setting in settings)],
            user=self._user,
            env={"LC_ALL": "C"},
            stderr=subprocess.DEVNULL,
            cwd=self._folder,
        )
        wait_until(self._answers)

    def stop(self) -> None:
        """Close every connection and end the server."""
        self._process.send_signal(signal.SIGINT)  # a "fast" shutdown, in PostgreSQL's words
        self._process.wait(PATIENCE)

    def new_database(self) -> str:
        """The URL of a new, empty database."""
        name = f"ledger_{uuid.uuid4().hex}"
        with closing(self._connect()) as connection:
            connection.execute(f'CREATE DATABASE "{name}"'.encode())
        return f"postgresql+psycopg://meshmark@127.0.0.1:{self.port}/{name}"

    def _connect(self) -> "psycopg.Connection[tuple[object, ...]]":
        return psycopg.connect(host="127.0.0.1", port=self.port, user="meshmark", dbname="postgres", autocommit=True)

    def _answers(self) -> bool:
        assert self._process.poll() is None, "PostgreSQL did not start"
        try:
            self._connect().close()
        except psycopg.OperationalError:
            return False
        return True

    def _run(self, program: str, *arguments: str) -> None:
        command = [os.fspath(self._programs / program), "-D", os.fspath(self._folder), *arguments]
        subprocess.run(command, check=True, user=self._user, env={"LC_ALL": "C"}, cwd=self._folder, capture_output=True)


def _programs() -> Path:
    """Where the server's programs lie; Debian keeps them out of the search path."""
    versions = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: float(path.parts[-3]))
    found = versions[-1] if versions else shutil.which("initdb")
    if found is None:
        pytest.fail("PostgreSQL is not installed: apt-get install postgresql", pytrace=False)
    return Path(found).resolve().parent


@contextmanager
def postgres_server(durable: bool = False) -> Iterator[Postgres]:
    """A running server, as safe as its own defaults or quick.

    PostgreSQL refuses to run as root: then it runs as the user its package made.
    """
    programs, user = _programs(), "postgres" if os.geteuid() == 0 else None
    with tempfile.TemporaryDirectory(prefix="meshmark-postgres-") as folder:  # pytest's own are closed to other users
        if user:
            os.chown(folder, pwd.getpwnam(user).pw_uid, -1)
        server = Postgres(programs, Path(folder), user, durable)
        server.start()
        try:
            yield server
        finally:
            server.stop()
