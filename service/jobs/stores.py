"""Choice of the artifact store by the settings."""

from service.config import Settings
from service.jobs.artifacts import ArtifactStore
from service.jobs.folder_store import FolderStore
from service.jobs.s3_store import S3Store


def open_store(settings: Settings) -> ArtifactStore:
    """Artifact store: a bucket where one is named, else a folder in `data_dir`."""
    if settings.store_url:
        return S3Store(settings)
    return FolderStore(settings.data_dir.resolve() / "artifacts")
