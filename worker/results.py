"""Files that the engine's process wrote. It has read a hostile file, so they may be no plain files."""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from core.errors import ErrorCode, MeshmarkError


def open_result(path: Path) -> BinaryIO:
    """Open a file that the engine wrote, for reading.

    A link could lead to files that the worker may read and the engine may not; a pipe would block the worker for ever.

    Raises:
        MeshmarkError: ``engine_crashed``, there is no plain file.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        raise _no_file() from None
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise _no_file()
    return os.fdopen(handle, "rb")


def replace_result(path: Path, content: bytes) -> None:
    """Replace a file that the engine wrote by a new one, without following it if it is a link."""
    path.unlink()
    with path.open("xb") as file:  # which follows no link
        file.write(content)


def _no_file() -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.ENGINE_CRASHED,
        "The process that worked on this asset left no file where its result should be.",
        "Send the asset again; if it happens again, re-export it from its authoring tool, or report this job's id.",
    )
