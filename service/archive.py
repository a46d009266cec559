"""ZIP archives of stored content, written while they are sent."""

import zipfile
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from service.jobs.artifacts import ArtifactStore
from service.jobs.models import Artifact

_EPOCH = (1980, 1, 1, 0, 0, 0)


class Entry(NamedTuple):
    """A file of an archive: stored, or at hand."""

    name: str
    content: Artifact | bytes


class _Sink:
    """Output of a ZipFile, which cannot go back in it."""

    def __init__(self) -> None:
        self._written: list[bytes] = []

    def write(self, data: bytes) -> int:
        """Take bytes."""
        self._written.append(bytes(data))
        return len(data)

    def flush(self) -> None:
        """Nothing is kept back."""

    def taken(self) -> bytes:
        """The bytes since the last time."""
        data = b"".join(self._written)
        self._written.clear()
        return data


def archived(store: ArtifactStore, entries: Iterable[Entry]) -> Iterator[bytes]:
    """An archive of files in their order, without dates and not packed further, in pieces of about a mebibyte.

    Raises:
        FileNotFoundError: content is gone.
        StoreUnavailableError: the store does not answer.
    """
    sink = _Sink()
    with zipfile.ZipFile(sink, "w") as archive:  # type: ignore[call-overload]  # its type asks for more than it uses
        for name, content in entries:
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.external_attr = 0o644 << 16
            if isinstance(content, bytes):
                entry.file_size, pieces = len(content), iter([content])
            else:
                entry.file_size, pieces = content.size, store.read(content.sha256, 0, content.size)
            with archive.open(entry, "w") as file:
                for piece in pieces:
                    file.write(piece)
                    yield sink.taken()
    yield sink.taken()
