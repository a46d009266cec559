"""Access rights of the data folder, which is private to this user: its ledger has secrets, its files are clients'
data."""

import os
import stat
import sys
from pathlib import Path

from sqlalchemy.engine import make_url

from service.config import Settings

OTHERS = stat.S_IRWXG | stat.S_IRWXO


def keep_private(settings: Settings) -> None:
    """Create the data folder if missing, remove other users' access to it, and to all files made from here on (umask).

    The rights of another owner's folder, such as a mounted volume, cannot be changed; it is accepted if only its owner
    and its group have access.

    Raises:
        SystemExit: with code 2 and a sentence on stderr, where every user has access to it, and keeps it.
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
