"""`meshmark` in a process of its own: in a pseudo-terminal, or with its streams caught."""

import os
import pty
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

COMMAND = [sys.executable, "-m", "core.cli"]
PLAIN = {"NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE", "GITHUB_ACTIONS", "PY_COLORS"}


def environment(**more: str) -> dict[str, str]:
    """This process's, without what other programs are told about colours."""
    kept = {name: value for name, value in os.environ.items() if name not in PLAIN}
    return kept | {"TERM": "xterm-256color", "COLUMNS": "100"} | more


def on_terminal(folder: Path, *arguments: str, **more: str) -> tuple[int, str]:
    """Run in a pseudo-terminal: the exit status, and all that it shows in the order it came."""
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [*COMMAND, *arguments], cwd=folder, stdin=theirs, stdout=theirs, stderr=theirs, env=environment(**more)
    ) as process:
        os.close(theirs)
        shown = b""
        with suppress(OSError):  # the end of a pseudo-terminal
            while part := os.read(ours, 1 << 16):
                shown += part
    os.close(ours)
    return process.returncode, shown.decode()


def piped(folder: Path, *arguments: str, data: bytes = b"", **more: str) -> "subprocess.CompletedProcess[bytes]":
    """Run with all streams caught."""
    return subprocess.run(
        [*COMMAND, *arguments], cwd=folder, input=data, capture_output=True, check=False, env=environment(**more)
    )
