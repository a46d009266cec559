"""`make fuzz`: mutated files through the whole engine, each in a process that is watched.

A case passes when it ends within its limits in one of our error codes or in a watermarked GLB: as valid as its input
was, with nothing left in it of what it no longer draws, and with marks that a viewer draws. Anything else (another
exception, a crash, a hang, too much memory) is a finding.
"""

import argparse
import json
import multiprocessing
import multiprocessing.connection
import random
import struct
import sys
import time
from collections import Counter
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import psutil

from tests.core.formats.samples import SAMPLES
from tests.core.gltf.builder import CUBE, CUBE_FACES, simple
from tests.core.gltf.compressed import draco, instanced, meshopted
from tests.core.gltf.rich import rich

TIME_LIMIT = 300.0  # seconds after which a case counts as a hang; a sound one of these sizes takes under two
MEMORY_LIMIT = 1536 * 2**20  # resident bytes of the process, torch and all
NUMBERS = (0, 1, -1, 2, 255, 65_535, 2**31 - 1, 2**32 - 1, 2**63, 1e30, -1e308, 0.5, 1e-40)
TOKENS = (b"nan", b"inf", b"-1", b"0", b"1e999", b"99999999999", b"", b"\xff\xfe", b"#", b"/", b"1/1/1", b"-9")


@cache
def seeds() -> list[bytes]:
    """The sound files that mutations start from."""
    cube = simple(CUBE, CUBE_FACES)
    offsets = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0]])
    special = [rich(), draco(cube), meshopted(cube), instanced(CUBE, CUBE_FACES, TRANSLATION=(offsets, "<f4"))]
    return [*SAMPLES.values(), *(document.to_glb() for document in special)]


def mutate(number: int) -> bytes:
    """Case ``number``: the same bytes at any time."""
    rng = random.Random(number)
    files = seeds()
    data = files[number % len(files)]
    for _ in range(rng.choice((1, 1, 1, 1, 2, 4))):
        is_glb = data[:4] == b"glTF" and len(data) > 20
        data = rng.choice((_flip, _overwrite, _cut, _double, _token, *((_property,) * 4 if is_glb else ())))(data, rng)
    return data


def _flip(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(max(len(data), 1))
    return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]


def _overwrite(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(max(len(data), 1))
    value = rng.choice((struct.pack("<I", rng.choice((0, 1, 2**31, 2**32 - 1, 65_536))), struct.pack("<f", 1e38)))
    value = rng.choice((value, struct.pack("<f", float("nan")), struct.pack("<f", float("inf"))))
    return data[:at] + value + data[at + len(value) :]


def _cut(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(max(len(data), 1))
    return data[:start] + data[start + rng.choice((1, 4, 50, len(data))) :]


def _double(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(max(len(data), 1))
    end = start + rng.choice((1, 4, 50, 500))
    return data[:end] + data[start:end] + data[end:]


def _token(data: bytes, rng: random.Random) -> bytes:
    words = data.split(b" ")
    words[rng.randrange(len(words))] = rng.choice(TOKENS)
    return b" ".join(words)


def _property(data: bytes, rng: random.Random) -> bytes:
    """One value somewhere in a GLB's JSON replaced, removed or copied elsewhere; the chunk lengths put right."""
    length = int.from_bytes(data[12:16], "little")
    try:
        document = json.loads(data[20 : 20 + length])
    except ValueError:
        return data
    places: list[tuple[Any, Any]] = []

    def visit(value: Any) -> None:
        pairs = list(value.items()) if isinstance(value, dict) else list(enumerate(value))
        for key, child in pairs:
            places.append((value, key))
            if isinstance(child, dict | list):
                visit(child)

    if not isinstance(document, dict) or not document:
        return data
    visit(document)
    parent, key = rng.choice(places)
    source, name = rng.choice(places)
    old = parent[key]
    negated = -old if isinstance(old, int | float) else True
    replacement: Any = rng.choice((rng.choice(NUMBERS), source[name], [], {}, None, "text", negated))
    if rng.random() < 0.2:
        del parent[key]
    else:
        parent[key] = replacement
    try:
        text = json.dumps(document).encode()
    except (ValueError, RecursionError):
        return data
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + data[20 + length :]
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def outcome(number: int) -> str:
    """What becomes of a case: "marked", an error code, or "FOUND: ..." with what is wrong.

    "marked, unjudged" is a result that carries damage of its input by which the judges, unlike viewers, stumble.
    """
    from core.choices import Evaluate
    from core.errors import MeshmarkError
    from core.formats.admission import admit, document_of
    from core.parameters import Parameters
    from core.pipeline import watermark
    from tests.drawn import undrawn
    from tests.residue import residue
    from tests.validator import ValidatorBrokenError, error_counts

    data = mutate(number)
    asked = Parameters(text="ab", count=2, size=2.0, evaluate=Evaluate.NONE)
    try:
        result = watermark(data, asked, preview=False)
    except MeshmarkError as error:
        return error.code.value if error.message and error.remedy else f"FOUND: {error.code} without words"
    except Exception as error:
        return f"FOUND: {type(error).__name__}: {error}"
    model = result.model
    is_gltf = data[:4] == b"glTF" or data.lstrip()[:1] == b"{"
    try:
        known = set(error_counts(data)) if is_gltf else set()
    except ValidatorBrokenError:
        return "marked"  # the validator itself breaks on some broken inputs: there is nothing to compare with
    new = set(error_counts(model)) - known
    if new:
        return f"FOUND: invalid result: {sorted(new)}"
    before = document_of(admit(data)).to_glb()
    try:
        left, unseen = residue(model, before), undrawn(model, result.report["watermarks"], before)
    except (KeyError, IndexError, TypeError, ValueError, OSError):
        return "marked, unjudged"
    if left:
        return f"FOUND: the result still holds something: {left[0]}"
    return f"FOUND: no viewer draws the marks {unseen}" if unseen else "marked"


@dataclass
class _Runner:
    """A process that answers one case after another, and the case it is at."""

    process: Any
    pipe: multiprocessing.connection.Connection
    case: int = -1
    since: float = 0.0


def _serve(pipe: multiprocessing.connection.Connection) -> None:
    while True:
        pipe.send(outcome(pipe.recv()))


def _start() -> _Runner:
    ours, theirs = multiprocessing.get_context("spawn").Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_serve, args=(theirs,), daemon=True)
    process.start()
    theirs.close()
    return _Runner(process, ours)


def _stop(runner: _Runner) -> None:
    runner.process.kill()
    runner.process.join()
    runner.pipe.close()


def run(cases: range, processes: int) -> dict[int, str]:
    """The outcome of every case by its number."""
    results: dict[int, str] = {}
    waiting = list(reversed(cases))
    runners = [_start() for _ in range(min(processes, len(cases)))]
    while len(results) < len(cases):
        for place, runner in enumerate(runners):
            if runner.case < 0 and waiting:
                runner.case, runner.since = waiting.pop(), time.monotonic()
                runner.pipe.send(runner.case)
            if runner.case < 0:
                continue
            ending = _ending(runner)
            if ending is None:
                continue
            results[runner.case] = ending
            if ending.startswith("FOUND: the process"):
                _stop(runner)
                runners[place] = _start()
            else:
                runner.case = -1
        time.sleep(0.005)
    for runner in runners:
        _stop(runner)
    return results


def _ending(runner: _Runner) -> str | None:
    """How a runner's case ended; None while it runs."""
    try:
        if runner.pipe.poll():
            return str(runner.pipe.recv())
    except EOFError:
        return f"FOUND: the process died with exit code {runner.process.exitcode}"
    if time.monotonic() - runner.since > TIME_LIMIT:
        return f"FOUND: the process took over {TIME_LIMIT:.0f} s"
    try:
        resident = psutil.Process(runner.process.pid).memory_info().rss
    except psutil.NoSuchProcess:
        return None
    return f"FOUND: the process grew to {resident:,} bytes" if resident > MEMORY_LIMIT else None


def main() -> int:
    """Prints how many cases ended how, and every finding; returns the number of findings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    results = run(range(options.first, options.first + options.cases), options.processes)
    findings = {number: ending for number, ending in results.items() if ending.startswith("FOUND")}
    for ending, count in Counter(
        ending for ending in results.values() if ending not in findings.values()
    ).most_common():
        print(f"{count:7} {ending}")
    for number, ending in sorted(findings.items()):
        print(f"case {number}: {ending}")
    print(f"{len(results)} cases, {len(findings)} findings")
    return len(findings)


if __name__ == "__main__":
    sys.exit(main())
