from pathlib import Path

import pytest

from service.config import Settings
from service.jobs.artifacts import ArtifactStore
from service.jobs.stores import open_store
from tests.service.s3 import bucket_settings


@pytest.fixture(params=["folder", "s3"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> ArtifactStore:
    """A new, empty store of each kind; the server of the second is started by the first test that asks for it."""
    if request.param == "folder":
        return open_store(Settings(data_dir=tmp_path))
    return open_store(bucket_settings(request.getfixturevalue("s3").new_bucket(), tmp_path))
