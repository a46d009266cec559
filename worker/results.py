"""What the engine's process wrote. It has read a hostile file, so what lies there may be no file at all."""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from core.errors import ErrorCode, MeshmarkError


def open_result(path: Path) -> BinaryIO:
    """A file that the engine wrote, open for reading.

    A link could lead to what the worker may read and the engine may not; a pipe would hold the worker up for ever.

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
    """Put a new file in the place of what the engine wrote, whatever that is and leads to."""
    path.unlink()
    with path.open("xb") as file:  # which follows no link
        file.write(content)


def _no_file() -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.ENGINE_CRASHED,
        "The process that worked on this asset left no file where its result should be.",
        "Send the asset again; if it happens again, re-export it from its authoring tool, or report this job's id.",
    )
