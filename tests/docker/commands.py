"""Commands of `make docker-test`, with their output and their failures."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).parents[2]
BEGAN = time.monotonic()
PATIENCE = 300.0  # seconds that anything may take that usually takes a few

Argument = str | os.PathLike[str]


class FailedError(Exception):
    """The deployment does not do what it should."""


def say(text: str) -> None:
    """A line about what is done, with the seconds since the beginning."""
    print(f"{time.monotonic() - BEGAN:6.0f} s  {text}", flush=True)


def stop(text: str) -> NoReturn:
    """End, with one line that says what is missing here."""
    sys.exit(f"docker-test: {text}")


def require(condition: object, text: str) -> None:
    """Fail unless it holds."""
    if not condition:
        raise FailedError(text)


def run(
    command: Sequence[Argument],
    environment: Mapping[str, str] | None = None,
    *,
    cwd: Argument = ROOT,
    check: bool = True,
    both: bool = False,
) -> str:
    """What a command wrote to stdout (with ``both``, and to stderr).

    Raises:
        FailedError: it failed, with the last that it said.
    """
    done = subprocess.run(
        command,
        cwd=cwd,
        env={**os.environ, **(environment or {})},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT if both else subprocess.PIPE,
        text=True,
        check=False,
    )
    if check and done.returncode:
        said = "\n".join((done.stdout + (done.stderr or "")).splitlines()[-30:])
        raise FailedError(f"`{' '.join(map(str, command))}` ended with {done.returncode}:\n{said}")
    return done.stdout


def wait_until(what: str, condition: Callable[[], object], patience: float = PATIENCE) -> None:
    """Ask again and again until it holds.

    Raises:
        FailedError: it never did.
    """
    deadline = time.monotonic() + patience
    while not condition():
        require(time.monotonic() < deadline, f"in {patience:.0f} s it did not come true that {what}")
        time.sleep(0.5)
