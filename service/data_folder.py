"""The data folder is this user's alone: the ledger in it has secrets, and its files are what clients sent."""

import os
import stat
import sys
from pathlib import Path

from sqlalchemy.engine import make_url

from service.config import Settings

OTHERS = stat.S_IRWXG | stat.S_IRWXO


def keep_private(settings: Settings) -> None:
    """Make the data folder where there is none, shut it to other users, and make no file from here on that they read.

    A folder that is another user's cannot be shut, such as a volume that was mounted. It will do where nobody but its
    owner and its group, who was chosen by whoever mounted it, may enter.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where it is open to everybody and stays so.
    """
    os.umask(OTHERS)
    folder = settings.data_dir.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    _shut(folder)
    if folder.stat().st_mode & stat.S_IRWXO:
        print(
            f"The data folder {folder} is open to every user of this machine, and belongs to another one, so it cannot "
            "be shut here: take it from the others (chmod o-rwx), or name a folder within it (MESHMARK_DATA_DIR).",
            file=sys.stderr,
        )
        sys.exit(2)
    for path in ledger_files(settings):
        if path.exists():
            _shut(path)


def ledger_files(settings: Settings) -> list[Path]:
    """The files of a ledger in SQLite, whether or not they are there."""
    url = make_url(settings.ledger_url)
    if url.get_backend_name() != "sqlite" or not url.database:
        return []
    return [Path(url.database + suffix).resolve() for suffix in ("", "-wal", "-shm")]


def _shut(path: Path) -> None:
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & OTHERS and os.geteuid() in (0, path.stat().st_uid):
        path.chmod(mode & ~OTHERS)
