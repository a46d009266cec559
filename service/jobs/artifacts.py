"""Artifact store: content addressed by its SHA-256. Its interface, and the staging that all stores share.

References to content, and its removal once there is none, are no concern of a store: see :mod:`service.jobs.contents`.
"""

import hashlib
import os
import re
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

import structlog

from core.errors import MeshmarkError
from service.errors import ServiceErrorCode
from service.jobs.reserve import Reserve

CHUNK = 2**20  # bytes read or written at a time
BLOCK = 2**16  # bytes written to probe the disk for room
DRAFT = ".staged-"  # prefix of the names of unfinished files
MARKER = "meshmark-ledger"  # name of the marker of the ledger that owns the store: see service.jobs.ownership
NAME = re.compile("[0-9a-f]{64}")  # of content; files with other names in a store are not ours
# Seconds for which content without a reference is kept: it may belong to a request in progress.
GRACE = 3600.0

log = structlog.get_logger(__name__)


class StoreUnavailableError(MeshmarkError):
    """Temporary failure: the store does not answer, or has no room."""

    def __init__(self) -> None:
        super().__init__(
            ServiceErrorCode.SERVICE_UNAVAILABLE,
            "The artifact store cannot be reached, or has no room.",
            "Send the request again in a few seconds; the operator can check the store.",
        )


@dataclass(frozen=True)
class Staged:
    """Content written to the local disk and hashed, not yet in the store."""

    path: Path
    sha256: str
    size: int


class Stored(NamedTuple):
    """Content in the store, and when it came there."""

    sha256: str
    since: datetime


class ArtifactStore(ABC):
    """Content by its hash. Stored content is complete and never changes.

    Every method may raise StoreUnavailableError.
    """

    def __init__(self, staging: Path) -> None:
        self._staging = staging
        staging.mkdir(parents=True, exist_ok=True)
        self.reserve = Reserve(staging)
        with suppress(OSError):  # reported by `stage_chunks` and `ping`
            self.reserve.keep()

    @abstractmethod
    def has(self, sha256: str) -> bool:
        """Test whether the content is there at this moment."""

    @abstractmethod
    def put(self, staged: Staged) -> None:
        """Store content durably; storing it again changes nothing."""

    @abstractmethod
    def read(self, sha256: str, start: int, stop: int) -> Iterator[bytes]:
        """The bytes from `start` up to `stop`, in chunks.

        Raises:
            FileNotFoundError: at the first chunk, where the content is not there.
        """

    @abstractmethod
    def remove(self, sha256: str) -> None:
        """Delete content if it is there; it is gone when this returns."""

    @abstractmethod
    def listing(self, prefix: str = "") -> Iterator[Stored]:
        """All content, or that whose hash begins with these two hexadecimal digits."""

    @abstractmethod
    def owner(self) -> str | None:
        """Ledger in the store's marker; None where there is none."""

    @abstractmethod
    def mark(self, ledger: str) -> None:
        """Mark the store as a ledger's, unless it is marked already; of any number of concurrent calls, one
        succeeds."""

    @abstractmethod
    def unmark(self) -> None:
        """Remove the marker if there is one."""

    @abstractmethod
    def link(self, sha256: str) -> str | None:
        """Presigned URL of the content, valid for some minutes; None where the store has no such thing."""

    def ping(self) -> None:
        """Raise StoreUnavailableError where the store does not answer or does not exist, or the local disk is full."""
        with writing():
            self.reserve.keep()
            with tempfile.TemporaryFile(dir=self._staging) as file:
                file.write(bytes(BLOCK))
                file.flush()
                os.fsync(file.fileno())

    @abstractmethod
    def put_upload(self, name: str, staged: Staged) -> None:
        """Store an upload under a name, in place of an earlier one; see :mod:`service.jobs.uploads`."""

    @abstractmethod
    def read_upload(self, name: str) -> Iterator[bytes]:
        """Chunks of the upload under a name.

        Raises:
            FileNotFoundError: at the first chunk, where there is none.
        """

    @abstractmethod
    def remove_upload(self, name: str) -> None:
        """Delete the upload under a name, if there is one."""

    @abstractmethod
    def upload_link(self, name: str, lifetime: timedelta) -> str | None:
        """Presigned URL to PUT an upload to, valid for so long; None where the store has no such thing."""

    def spool(self) -> BinaryIO:
        """Temporary file for arriving content, on the disk where it is staged; in memory while it is small."""
        file = tempfile.SpooledTemporaryFile(max_size=CHUNK, prefix=DRAFT, dir=os.fspath(self._staging))  # noqa: SIM115
        return cast(BinaryIO, file)

    def stage(self, stream: BinaryIO, *, limit: int, name: str) -> AbstractContextManager[Staged]:
        """Copy a stream to the local disk, hashing as it goes; the copy is removed after the block.

        Raises:
            MeshmarkError: ``upload_too_large`` as soon as more than `limit` bytes came.
        """
        return self.stage_chunks(iter(lambda: stream.read(CHUNK), b""), limit=limit, name=name)

    @contextmanager
    def stage_chunks(self, chunks: Iterable[bytes], *, limit: int, name: str) -> Iterator[Staged]:
        """Stage chunks, as :meth:`stage` does a stream."""
        with writing():
            self.reserve.keep()
            handle, temporary = tempfile.mkstemp(prefix=DRAFT, dir=self._staging)
        path = Path(temporary)
        try:
            # Around all of it: closing the file retries a write that failed.
            with writing(), os.fdopen(handle, "wb") as target:
                digest, size = hashlib.sha256(), 0
                for chunk in chunks:
                    size += len(chunk)
                    if size > limit:
                        raise MeshmarkError(
                            ServiceErrorCode.UPLOAD_TOO_LARGE,
                            f"The {name} is larger than {limit:,} bytes, the most accepted here.",
                            "Send a smaller one, or ask the operator to raise the limit.",
                        )
                    digest.update(chunk)
                    target.write(chunk)
                target.flush()
                os.fsync(target.fileno())
            yield Staged(path, digest.hexdigest(), size)
        finally:
            path.unlink(missing_ok=True)

    def fetch(self, sha256: str, size: int, target: Path) -> None:
        """Copy content into a file, and check its hash.

        Raises:
            FileNotFoundError: the content is not there.
            ValueError: the stored content is damaged.
        """
        digest = hashlib.sha256()
        with writing():
            file = target.open("wb", buffering=0)
        with file:
            for chunk in self.read(sha256, 0, size):
                digest.update(chunk)
                with writing():
                    while chunk := chunk[file.write(chunk) :]:
                        pass
        if digest.hexdigest() != sha256:
            raise ValueError(f"the stored content {sha256} is damaged")

    @contextmanager
    def fetched(self, sha256: str, size: int) -> Iterator[Path]:
        """Content in a file on the local disk, which is removed after the block; raises what :meth:`fetch` does."""
        with writing():
            handle, path = tempfile.mkstemp(prefix=DRAFT, dir=self._staging)
            os.close(handle)
        try:
            self.fetch(sha256, size, Path(path))
            yield Path(path)
        finally:
            Path(path).unlink(missing_ok=True)

    def clear_staging(self, age: float) -> None:
        """Remove the drafts that killed processes left on the local disk, once they are `age` seconds old."""
        for draft in self._staging.glob(f"{DRAFT}*"):
            with suppress(FileNotFoundError):
                if draft.stat().st_mtime < time.time() - age:
                    draft.unlink()


@contextmanager
def writing() -> Iterator[None]:
    """Report a full or broken disk as a store that is not available."""
    try:
        yield
    except OSError as error:
        log.error("the disk cannot be written to", error=str(error))
        raise StoreUnavailableError from error
