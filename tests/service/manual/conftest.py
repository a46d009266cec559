from pathlib import Path

import pytest
from filelock import FileLock

from service.manual.build import build
from tests.service.console.conftest import browser as browser  # a fixture


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The manual as it is built of the pages there are; once for all processes of the suite."""
    base = tmp_path_factory.getbasetemp()
    shared = base if worker_id == "master" else base.parent
    built = shared / "manual"
    with FileLock(shared / "manual.lock"):
        if not built.exists():
            build(built)
    return built
