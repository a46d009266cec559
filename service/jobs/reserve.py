"""Disk space reserved for deletions, which take some to be recorded, for when the disk is full."""

import os
from pathlib import Path

SIZE = 4 * 2**20  # bytes: some hundred deletions; of a small disk, no more than a sixteenth


class Reserve:
    """File that reserves disk space, and is removed when deletions need it.

    Nothing is stored while it is not there. So whatever fills the disk, clients' uploads cannot take the room of the
    deletions by which they may free it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._path = folder, folder / "reserve"

    def keep(self) -> None:
        """Reserve the space, unless it is reserved already.

        Raises:
            OSError: there is none.
        """
        disk = os.statvfs(self._folder)
        size = min(SIZE, disk.f_blocks * disk.f_frsize // 16)
        with self._path.open("ab") as file:
            if os.fstat(file.fileno()).st_size >= size:
                return
            try:
                os.posix_fallocate(file.fileno(), 0, size)
            except OSError:
                self._path.unlink(missing_ok=True)
                raise

    def give_up(self) -> bool:
        """Release the space, if the disk is full; True where there is room now that was not there before."""
        disk = os.statvfs(self._folder)
        if disk.f_bavail * disk.f_frsize >= SIZE or not self._path.exists():
            return False
        self._path.unlink(missing_ok=True)
        return True
