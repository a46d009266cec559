"""Servers that many tests share: each is started once by a test process, when the first test asks for it."""

import os
from collections.abc import Iterator

import pytest

from tests.service.postgres import Postgres, postgres_server
from tests.service.s3 import S3, s3_server

os.environ.setdefault("MESHMARK_CACHE", "false")  # tests send the same asset often, and mean to see it worked on


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    with postgres_server() as server:
        yield server


@pytest.fixture(scope="session")
def s3() -> Iterator[S3]:
    with s3_server() as server:
        yield server
