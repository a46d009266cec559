"""Servers that many tests share: each is started once by a test process, when the first test asks for it."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck
from hypothesis import settings as hypothesis_settings

from service.config import Settings
from tests.service.conftest import Client, client_with
from tests.service.postgres import Postgres, postgres_server
from tests.service.s3 import S3, bucket_settings, s3_server
from tests.service.watched import Watched

# The only place for what depends on the clock: an example, or making it, may take as long as a busy machine needs.
hypothesis_settings.register_profile("meshmark", deadline=None, suppress_health_check=[HealthCheck.too_slow])
hypothesis_settings.load_profile("meshmark")

os.environ.setdefault("MESHMARK_CACHE", "false")  # tests send the same asset often, and mean to see it worked on


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    with postgres_server() as server:
        yield server


@pytest.fixture(scope="session")
def s3() -> Iterator[S3]:
    with s3_server() as server:
        yield server


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A new, empty database of each kind; PostgreSQL is started by the first test that asks for it."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'folder' / 'ledger.sqlite3'}"
    return str(request.getfixturevalue("postgres").new_database())


@pytest.fixture
def watched(s3: S3) -> Watched:
    """A bucket with a hook."""
    return Watched(s3.new_bucket(), s3.url)


@pytest.fixture
def hooked(watched: Watched, tmp_path: Path) -> Iterator[Client]:
    """A client of a service with this hook."""
    with client_with(Settings(data_dir=tmp_path, hooks_file=watched.hooks_file(tmp_path))) as client:
        yield client


@pytest.fixture
def hooked_on_both(
    request: pytest.FixtureRequest, watched: Watched, database_url: str, tmp_path: Path
) -> Iterator[Client]:
    """The same on each database: beside SQLite with artifacts in a folder, beside PostgreSQL in a bucket."""
    more: dict[str, Any] = {"database_url": database_url, "hooks_file": watched.hooks_file(tmp_path)}
    if database_url.startswith("sqlite"):
        settings = Settings(data_dir=tmp_path, **more)
    else:
        settings = bucket_settings(request.getfixturevalue("s3").new_bucket(), tmp_path, **more)
    with client_with(settings) as client:
        yield client
