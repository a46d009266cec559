"""Artifact store in a bucket of Amazon S3 or of another store with its protocol (MinIO, Ceph, R2, ...)."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import timedelta
from typing import Any

import obstore
import structlog
from obstore.exceptions import AlreadyExistsError, BaseError

from service.config import Settings
from service.jobs.artifacts import CHUNK, MARKER, NAME, ArtifactStore, Staged, Stored, StoreUnavailableError
from service.jobs.s3_bucket import error_line, open_bucket

PIECE = 8 * 2**20  # bytes of one range request: a slow client holds no connection to the store
PARTS = 2  # of 5 MiB in memory at a time for each large file that is put; the library's default is twelve
LINK_LIFETIME = timedelta(minutes=5)  # of a presigned URL
# Time-outs of connecting and of a request. With a failing store a request ends after about ten seconds; workers retry.
TIMEOUTS = ("3s", "30s")
RETRIES: Any = {"max_retries": 2, "retry_timeout": timedelta(seconds=10), "backoff": {"base": 2}}

log = structlog.get_logger(__name__)


class S3Store(ArtifactStore):
    """Objects `<prefix>/<aa>/<sha256>` in one bucket, which must be there already."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(staging=settings.data_dir.resolve() / "staging")
        bucket, _, prefix = settings.store_url.removeprefix("s3://").partition("/")
        self._url = settings.store_url
        self._presign = settings.s3_presign
        self._bucket = open_bucket(
            bucket,
            prefix.strip("/") or None,
            settings.s3_endpoint,
            settings.s3_region,
            settings.s3_access_key_id,
            settings.s3_secret_access_key,
            TIMEOUTS,
            RETRIES,
        )

    def has(self, sha256: str) -> bool:
        """Test whether the object exists; S3 is strongly consistent."""
        try:
            with _asking(may_be_missing=True):
                obstore.head(self._bucket, _key(sha256))
        except FileNotFoundError:
            return False
        return True

    def put(self, staged: Staged) -> None:
        """Upload the staged file; it appears when it is whole."""
        with _asking():
            obstore.put(self._bucket, _key(staged.sha256), staged.path, max_concurrency=PARTS)

    def read(self, sha256: str, start: int, stop: int) -> Iterator[bytes]:
        """The bytes from `start` up to `stop`; in several requests, which is safe for content that never changes."""
        if start == stop and not self.has(sha256):  # a range of no bytes cannot be asked for
            raise FileNotFoundError(sha256)
        for begin in range(start, stop, PIECE):
            with _asking(may_be_missing=True):
                piece = obstore.get_range(self._bucket, _key(sha256), start=begin, end=min(begin + PIECE, stop))
            yield bytes(piece)

    def remove(self, sha256: str) -> None:
        """Delete the object."""
        with _asking():
            obstore.delete(self._bucket, _key(sha256))

    def listing(self, prefix: str = "") -> Iterator[Stored]:
        """The objects by their names."""
        with _asking():
            for page in obstore.list(self._bucket, prefix or None, chunk_size=1000):
                for item in page:
                    name = item["path"].rpartition("/")[2]
                    if NAME.fullmatch(name) and item["path"] == _key(name):
                        yield Stored(name, item["last_modified"])

    def ping(self) -> None:
        """Check that the bucket can be listed; a test for one object would not notice a missing bucket."""
        super().ping()
        with _asking():
            next(iter(obstore.list(self._bucket, "ping", chunk_size=1)), None)

    def owner(self) -> str | None:
        """Read the marker object."""
        try:
            with _asking(may_be_missing=True):
                return bytes(obstore.get(self._bucket, MARKER).bytes()).decode()
        except FileNotFoundError:
            return None

    def mark(self, ledger: str) -> None:
        """Write the marker object by a conditional request (`If-None-Match: *`)."""
        with _asking(), suppress(AlreadyExistsError):
            obstore.put(self._bucket, MARKER, ledger.encode(), mode="create")

    def unmark(self) -> None:
        """Delete the marker object."""
        with _asking():
            obstore.delete(self._bucket, MARKER)

    def __str__(self) -> str:
        return f"The bucket {self._url}"

    def link(self, sha256: str) -> str | None:
        """Presigned URL, where the settings allow it."""
        if not self._presign:
            return None
        with _asking():
            return obstore.sign(self._bucket, "GET", _key(sha256), LINK_LIFETIME)

    def put_upload(self, name: str, staged: Staged) -> None:
        """Upload the staged file."""
        with _asking():
            obstore.put(self._bucket, _upload_key(name), staged.path, max_concurrency=PARTS)

    def read_upload(self, name: str) -> Iterator[bytes]:
        """The object's content, of one version of it however often it is put meanwhile."""
        with _asking(may_be_missing=True):
            chunks = obstore.get(self._bucket, _upload_key(name)).stream(min_chunk_size=CHUNK)
            for chunk in chunks:
                yield bytes(chunk)

    def remove_upload(self, name: str) -> None:
        """Delete the object."""
        with _asking():
            obstore.delete(self._bucket, _upload_key(name))

    def upload_link(self, name: str, lifetime: timedelta) -> str | None:
        """Presigned URL, where the settings allow it."""
        if not self._presign:
            return None
        with _asking():
            return obstore.sign(self._bucket, "PUT", _upload_key(name), lifetime)


def _upload_key(name: str) -> str:
    return f"uploads/{name}"


def _key(sha256: str) -> str:
    return f"{sha256[:2]}/{sha256}"


@contextmanager
def _asking(*, may_be_missing: bool = False) -> Iterator[None]:
    """Convert failures of the store; a missing object is told from them where it is expected, else it is the bucket."""
    try:
        yield
    except (BaseError, OSError) as error:
        if may_be_missing and isinstance(error, FileNotFoundError):
            raise
        log.warning("the artifact store failed", error=error_line(error))
        raise StoreUnavailableError from error
