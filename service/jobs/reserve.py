"""Room on the disk that is kept for when all other is gone: to write down that files are deleted takes some, too."""

import os
from pathlib import Path

SIZE = 4 * 2**20  # bytes: some hundred deletions; of a small disk, no more than a sixteenth


class Reserve:
    """A file that holds room, and is given up where room is to be made.

    Nothing is stored while it is not there. So whatever fills the disk, it is not what clients send that takes the
    room of the deletions by which they may free it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._path = folder, folder / "reserve"

    def keep(self) -> None:
        """Take the room, unless it is taken already.

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
        """Let the room go, if the disk is full; whether there is room now that was none before."""
        disk = os.statvfs(self._folder)
        if disk.f_bavail * disk.f_frsize >= SIZE or not self._path.exists():
            return False
        self._path.unlink(missing_ok=True)
        return True
