"""Download the asset of a job whose client did not send it.

A worker does so itself, before it starts the engine and under the job's own lease: so a download is canceled, retried
after a crash, counted and given up as any other part of a job, and needs no queue and no states of its own. The
engine's process has no part in it. It is bounded: three tries of two minutes. The bucket of a hook is retried as the
artifact store is.
"""

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import structlog
from sqlalchemy.orm import Session, sessionmaker

from core.errors import MeshmarkError
from service.config import Settings
from service.errors import ServiceErrorCode
from service.jobs import dropped, sources
from service.jobs.artifacts import writing
from service.outbound.client import OutboundClient
from service.outbound.download import TransientDownloadError, download
from service.outbound.policy import Timeouts
from worker.hook_bucket import read_object

TIMEOUTS = Timeouts(connect=5.0, silence=15.0, total=120.0)  # seconds, for each try
PAUSES = (1.0, 5.0)  # seconds before the second and the third try

log = structlog.get_logger(__name__)


class Sources:
    """Downloads assets from their sources: addresses, and the buckets of upload hooks."""

    def __init__(self, settings: Settings, sessions: sessionmaker[Session]) -> None:
        self._limit = settings.max_upload_bytes
        self._hooks = settings.hooks
        self._sessions = sessions
        self._client = OutboundClient(settings.outbound, TIMEOUTS)

    def bring(self, job_id: str, path: Path, check: Callable[[], None], pause: Callable[[float], object]) -> bool:
        """Write a job's asset to a file; False where no source of it is known.

        Args:
            job_id: the job.
            path: the file to write.
            check: called often; an error in it ends the download.
            pause: waits so many seconds.

        Raises:
            MeshmarkError: ``address_refused``, ``download_failed``, ``download_too_large``.
            StoreUnavailableError: the file could not be written, or the bucket of a hook does not answer.
        """
        fetch = self._fetcher(job_id, check)
        if fetch is None:
            return False
        for seconds in PAUSES:
            try:
                _write(path, fetch)
                return True
            except TransientDownloadError as trouble:
                log.info("the asset could not be fetched; trying again", reason=trouble.message)
            pause(seconds)
        _write(path, fetch)
        return True

    def _fetcher(self, job_id: str, check: Callable[[], None]) -> Callable[[BinaryIO], object] | None:
        """Function that writes a job's asset to an open file; None where no source of it is known."""
        if url := sources.url_of(self._sessions, job_id):
            return lambda target: download(self._client, url, target, self._limit, check)
        if item := dropped.object_of(self._sessions, job_id):
            hook = self._hooks.get(item.source)
            if hook is None:
                raise MeshmarkError(
                    ServiceErrorCode.DOWNLOAD_FAILED,
                    f"The hook {item.source!r} that told of this object is not configured any more.",
                    "Configure it again, for API and workers, and drop the object again.",
                )
            return lambda target: read_object(hook, item.key, target, self._limit, check)
        return None


def _write(path: Path, fetch: Callable[[BinaryIO], object]) -> None:
    with writing(), path.open("wb") as target:
        fetch(target)
