"""Artifact store in a folder that API and workers share."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from service.jobs.artifacts import CHUNK, DRAFT, MARKER, NAME, ArtifactStore, Staged, Stored, writing


class FolderStore(ArtifactStore):
    """A folder of files `<aa>/<sha256>`, on the local disk or on a shared one that has hard links."""

    def __init__(self, root: Path) -> None:
        super().__init__(staging=root)
        self.root = root

    def path(self, sha256: str) -> Path:
        """Path of this content, whether or not it exists."""
        return self.root / sha256[:2] / sha256

    def has(self, sha256: str) -> bool:
        """Test whether the file exists."""
        return self.path(sha256).exists()

    def put(self, staged: Staged) -> None:
        """Give the staged file its final name too, at once and durably."""
        target = self.path(staged.sha256)
        with writing():
            target.parent.mkdir(exist_ok=True)
            with suppress(FileExistsError):
                os.link(staged.path, target)
            _sync(target.parent)

    def read(self, sha256: str, start: int, stop: int) -> Iterator[bytes]:
        """The bytes from `start` up to `stop`."""
        with self.path(sha256).open("rb") as file:
            file.seek(start)
            while start < stop and (chunk := file.read(min(CHUNK, stop - start))):
                start += len(chunk)
                yield chunk

    def remove(self, sha256: str) -> None:
        """Delete the file."""
        with writing():
            self.path(sha256).unlink(missing_ok=True)

    def listing(self, prefix: str = "") -> Iterator[Stored]:
        """The files by their names."""
        for path in self.root.glob(f"{prefix or '??'}/*"):
            if NAME.fullmatch(path.name) and path == self.path(path.name):
                with suppress(FileNotFoundError):
                    yield Stored(path.name, datetime.fromtimestamp(path.stat().st_mtime, UTC))

    def owner(self) -> str | None:
        """Read the marker file."""
        try:
            return (self.root / MARKER).read_text()
        except FileNotFoundError:
            return None

    def mark(self, ledger: str) -> None:
        """Write the marker file and give it its name, which only the first one can."""
        with writing(), tempfile.NamedTemporaryFile("w", prefix=DRAFT, dir=self.root) as draft:
            draft.write(ledger)
            draft.flush()
            os.fsync(draft.fileno())
            with suppress(FileExistsError):
                os.link(draft.name, self.root / MARKER)

    def unmark(self) -> None:
        """Delete the marker file."""
        with writing():
            (self.root / MARKER).unlink(missing_ok=True)

    def __str__(self) -> str:
        return f"The folder {self.root}"

    def link(self, sha256: str) -> None:  # noqa: ARG002
        """Return None: a folder has no URLs."""
        return

    def put_upload(self, name: str, staged: Staged) -> None:
        """Give the staged file its final name, at once and durably."""
        target = self._upload(name)
        with writing():
            target.parent.mkdir(exist_ok=True)
            staged.path.replace(target)
            _sync(target.parent)

    def read_upload(self, name: str) -> Iterator[bytes]:
        """The file's content."""
        with self._upload(name).open("rb") as file:
            yield from iter(lambda: file.read(CHUNK), b"")

    def remove_upload(self, name: str) -> None:
        """Delete the file."""
        with writing():
            self._upload(name).unlink(missing_ok=True)

    def upload_link(self, name: str, lifetime: timedelta) -> None:  # noqa: ARG002
        """Return None: a folder has no URLs."""
        return

    def _upload(self, name: str) -> Path:
        return self.root / "uploads" / name


def _sync(path: Path) -> None:
    """Make the names in a folder durable."""
    folder = os.open(path, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
