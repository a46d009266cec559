"""Stored content, named by its SHA-256: what every store can do, and what all of them do alike.

Which rows refer to content, and when it may be removed, is no concern of a store: see :mod:`service.jobs.contents`.
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

CHUNK = 2**20
BLOCK = 2**16  # bytes written to see whether there is room
DRAFT = ".staged-"
MARKER = "meshmark-ledger"  # names the ledger whose the store is: see service.jobs.ownership
NAME = re.compile("[0-9a-f]{64}")  # what else lies in a store was not put there by us
# Content without a reference that is younger than this may be that of a request still at work.
GRACE = 3600.0

log = structlog.get_logger(__name__)


class StoreUnavailableError(MeshmarkError):
    """The store does not answer, or has no room; it may soon."""

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
    """Content by its hash. What is there is complete and never changes.

    Every method may raise StoreUnavailableError.
    """

    def __init__(self, staging: Path) -> None:
        self._staging = staging
        staging.mkdir(parents=True, exist_ok=True)
        self.reserve = Reserve(staging)
        with suppress(OSError):  # whoever stores something, or asks whether that is possible, is told
            self.reserve.keep()

    @abstractmethod
    def has(self, sha256: str) -> bool:
        """Whether the content is there at this moment."""

    @abstractmethod
    def put(self, staged: Staged) -> None:
        """Store content durably; storing it twice is as good as once."""

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
        """The ledger that the store is marked with; None where it is not."""

    @abstractmethod
    def mark(self, ledger: str) -> None:
        """Mark the store as a ledger's, unless it is marked already; of any number at once, one succeeds."""

    @abstractmethod
    def unmark(self) -> None:
        """Remove the mark if there is one."""

    @abstractmethod
    def link(self, sha256: str) -> str | None:
        """An address, good for some minutes, where anyone may fetch the content; None where there is no such thing."""

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
        """Keep what a client sent ahead under a name, in place of what was there; see :mod:`service.jobs.uploads`."""

    @abstractmethod
    def read_upload(self, name: str) -> Iterator[bytes]:
        """What was sent ahead under a name.

        Raises:
            FileNotFoundError: at the first chunk, where nothing was.
        """

    @abstractmethod
    def remove_upload(self, name: str) -> None:
        """Delete what was sent ahead under a name, if anything was."""

    @abstractmethod
    def upload_link(self, name: str, lifetime: timedelta) -> str | None:
        """An address to which anyone may PUT an upload for so long; None where there is no such thing."""

    def spool(self) -> BinaryIO:
        """A file without a name for what arrives, on the disk where content is staged; in memory while it is small."""
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
        """As :meth:`stage`, from chunks."""
        with writing():
            self.reserve.keep()
            handle, temporary = tempfile.mkstemp(prefix=DRAFT, dir=self._staging)
        path = Path(temporary)
        try:
            # Around all of it: what could not be written is tried once more by closing the file.
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
        """Copy content into a file of one's own.

        Raises:
            FileNotFoundError: the content is not there.
            ValueError: what is there is not what was stored.
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
        """Remove what processes that were killed left on the local disk, once it is so many seconds old."""
        for draft in self._staging.glob(f"{DRAFT}*"):
            with suppress(FileNotFoundError):
                if draft.stat().st_mtime < time.time() - age:
                    draft.unlink()


@contextmanager
def writing() -> Iterator[None]:
    """A disk that is full or broken is a store that is not available."""
    try:
        yield
    except OSError as error:
        log.error("the disk cannot be written to", error=str(error))
        raise StoreUnavailableError from error
