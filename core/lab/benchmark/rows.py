"""The rows of a benchmark: their identity, and the file that keeps them through every interruption."""

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from core import __version__
from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.options import INVISIBLE, NO_ATTACK, REMOVAL, AttackRequest, BenchmarkOptions

Row = dict[str, Any]

ROWS = "rows.jsonl"


@dataclass(frozen=True)
class Combination:
    """One row to make of an asset: a method at a count, and the attack on its result."""

    method: str
    count: int
    attack: AttackRequest

    def identity(self, sha256: str, seed: int, options: BenchmarkOptions) -> Row:
        """Identity of this row among all others; the same identity always means the same values."""
        return {
            "sha256": sha256,
            "method": self.method,
            "count": self.count,
            "attack": self.attack.name,
            "strength": self.attack.strength,
            "seed": seed,
            "version": __version__,
            "settings": options.settings(),
        }


def combinations(options: BenchmarkOptions) -> list[Combination]:
    """All combinations for one asset; those of one method and count stand together, the unattacked one first."""
    attacks = list(dict.fromkeys(options.attacks))
    found = []
    for method in dict.fromkeys(options.methods):
        for count in (0,) if method == INVISIBLE else dict.fromkeys(options.counts):
            found.append(Combination(method, count, AttackRequest(NO_ATTACK)))
            if method == INVISIBLE or count in options.attacked_counts:
                # Removal deletes letters, and an invisible watermark has none.
                possible = [attack for attack in attacks if (method, attack.name) != (INVISIBLE, REMOVAL)]
                found += [Combination(method, count, attack) for attack in possible]
    return found


def grouped(wanted: list[Combination]) -> list[list[Combination]]:
    """Combinations in groups that share a marked asset."""
    return [list(group) for _, group in groupby(wanted, key=lambda one: (one.method, one.count))]


def key(identity: Row) -> str:
    """A short name of an identity, as in :meth:`Combination.identity`."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:20]


def asset_seed(sha256: str, seed: int) -> int:
    """The seed of all draws on one asset: independent of the machine and of the other assets of a run."""
    return int.from_bytes(hashlib.sha256(f"{seed}:{sha256}".encode()).digest()[:4])


def read(out: Path) -> list[Row]:
    """The rows kept in ``out``; of several for one identity the last. A half-written last line is left out.

    Raises:
        MeshmarkError: ``malformed_file`` where another line than the last is damaged.
    """
    path = out / ROWS
    lines = path.read_bytes().split(b"\n")[:-1] if path.exists() else []
    found: dict[str, Row] = {}
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            found.pop(row["key"], None)
            found[row["key"]] = row
        except (ValueError, KeyError, TypeError) as error:
            raise MeshmarkError(
                ErrorCode.MALFORMED_FILE,
                f"Line {number} of {path} is not a row ({type(error).__name__}).",
                "Delete that line; its row is then made again.",
            ) from error
    return list(found.values())


class Log:
    """Appends rows; each is on the disk when :meth:`append` returns. Made by :func:`appending`."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    def append(self, row: Row) -> None:
        """Keep one row."""
        line = json.dumps(row, sort_keys=True, allow_nan=False).encode() + b"\n"
        while line:
            line = line[os.write(self._descriptor, line) :]
        os.fsync(self._descriptor)


@contextmanager
def appending(out: Path) -> Iterator[Log]:
    """The row file of ``out``, open for one run at a time, without the half line that a killed run may have left.

    Raises:
        MeshmarkError: ``output_not_writable``, also while another run writes there.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(out / ROWS, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    except OSError as error:
        raise MeshmarkError(
            ErrorCode.OUTPUT_NOT_WRITABLE, f"{out} cannot be written: {error.strerror}.", "Choose another --out."
        ) from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise MeshmarkError(
                ErrorCode.OUTPUT_NOT_WRITABLE,
                f"Another benchmark is writing to {out}.",
                "Wait for it, or choose another --out.",
            ) from None
        os.ftruncate(descriptor, (out / ROWS).read_bytes().rfind(b"\n") + 1)
        yield Log(descriptor)
    finally:
        os.close(descriptor)
