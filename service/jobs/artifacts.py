"""Stored files, named by the SHA-256 of their content, in one folder that API and workers share."""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from core.errors import ErrorCode, MeshmarkError

CHUNK = 2**20


@dataclass(frozen=True)
class Staged:
    """Content written to disk and hashed, not yet under its final name."""

    path: Path
    sha256: str
    size: int


class ArtifactStore:
    """A folder of files `<aa>/<sha256>`; a file under its final name is always complete."""

    def __init__(self, root: Path) -> None:
        self.root = root
        root.mkdir(parents=True, exist_ok=True)

    def path(self, sha256: str) -> Path:
        """Where this content is or would be."""
        return self.root / sha256[:2] / sha256

    @contextmanager
    def stage(self, stream: BinaryIO, *, limit: int, name: str) -> Iterator[Staged]:
        """Copy a stream to disk, hashing as it goes; what is not added inside the block is removed after it.

        Raises:
            MeshmarkError: ``upload_too_large`` as soon as more than `limit` bytes came.
        """
        handle, temporary = tempfile.mkstemp(prefix=".staged-", dir=self.root)
        path = Path(temporary)
        try:
            digest, size = hashlib.sha256(), 0
            with os.fdopen(handle, "wb") as target:
                while chunk := stream.read(CHUNK):
                    size += len(chunk)
                    if size > limit:
                        raise MeshmarkError(
                            ErrorCode.UPLOAD_TOO_LARGE,
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

    @contextmanager
    def exclusive(self) -> Iterator[None]:
        """No other thread or process adds or removes content meanwhile.

        Content is added together with the row that refers to it, and removed after a look at the rows: without the
        lock, a removal between the two would leave a row that refers to nothing.
        """
        with (self.root / ".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def add(self, staged: Staged) -> None:
        """Give staged content its final name, at once and durably. Call inside :meth:`exclusive`."""
        target = self.path(staged.sha256)
        target.parent.mkdir(exist_ok=True)
        staged.path.rename(target)
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def remove(self, sha256: str) -> None:
        """Delete content if it is there. Call inside :meth:`exclusive`, for content no row refers to."""
        with suppress(FileNotFoundError):
            self.path(sha256).unlink()
