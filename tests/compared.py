"""`make compared MESHES=DIR`: how surely suspects are laid on their originals, and marks told from none, by attack.

Each asset is marked with default parameters and without a colour, attacked, and compared with the original by the
job's report; the asset without marks is a negative, and the next assets of the folder are other models. A row is
printed as each is done, and the rates at the end.
"""

import argparse
import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from core.budgets import DEFAULT_BUDGETS
from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.surface import Surface
from core.gltf.scene import flatten
from core.lab.attacks.attack import attack_file
from core.lab.attacks.plain_file import read_plain
from core.lab.plain import Mesh, plain_glb
from core.parameters import Parameters
from core.pipeline import watermark
from core.verify.original import Against, Reference, align, compare, read_reference
from tests.survey import assets
from tests.verified import ATTACKS, TEXT, UNMARKED, UNTOUCHED

# Moved: turned, scaled and shifted.
MOVED, MOVED_CROP, OTHER = "moved", "moved crop", "other model"
OTHERS = 1, 5, 11  # assets further on that each is compared with


class Row(NamedTuple):
    """A comparison: residual and covered as in the report, and marks that are there, that are not, and that are gone.

    Without residual where the suspect was taken for another model.
    """

    file: str
    attack: str
    seconds: float
    residual: float | None = None
    covered: float | None = None
    there: int = 0
    missing: int = 0
    gone: int = 0


def main() -> int:
    """Prints a row for each comparison, and the rates by attack."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", action="append", help="start of a file's name; may be given several times")
    parser.add_argument("--attacks", default="", help=f"of {', '.join([*ATTACKS, MOVED_CROP])}; with commas between")
    options = parser.parse_args()
    attacks = [name.strip() for name in options.attacks.split(",") if name.strip()]
    paths = list(assets(options.folder, options.only))
    found: dict[str, list[Row]] = defaultdict(list)
    for number, path in enumerate(paths):
        others = [paths[(number + step) % len(paths)] for step in OTHERS if step % len(paths)]
        for row in _rows(path, others, attacks):
            print(json.dumps(row, ensure_ascii=False), flush=True)
            found[row.attack].append(row)
    print("\n| file | taken for the same model | residual, most | marks there | not there | gone |")
    print("| --- | --- | --- | --- | --- | --- |")
    for attack, rows in found.items():
        residuals = [row.residual for row in rows if row.residual is not None]
        marks = " | ".join(str(sum(column)) for column in zip(*(row[5:] for row in rows), strict=True))
        most = 100 * max(residuals, default=0.0)
        print(f"| {attack} | {len(residuals)} of {len(rows)} | {most:.2g} % | {marks} |")
    return 0


def _rows(path: Path, others: list[Path], attacks: list[str]) -> Iterator[Row]:
    data = path.read_bytes()
    try:
        result = watermark(data, Parameters(text=TEXT, color="none", evaluate=Evaluate.NONE), preview=False)
    except MeshmarkError:
        return
    reference = read_reference(Against(data, json.dumps(result.report).encode()), DEFAULT_BUDGETS)
    yield _row(path, UNMARKED, data, reference)
    yield _row(path, UNTOUCHED, result.model, reference)
    yield _row(path, MOVED, _moved(result.model), reference)
    for attack in attacks:
        kind, strength = ("crop", None) if attack == MOVED_CROP else ATTACKS[attack]
        try:
            attacked = attack_file(result.model, kind, strength, 0, data)
        except MeshmarkError:
            continue
        yield _row(path, attack, _moved(attacked) if attack == MOVED_CROP else attacked, reference)
    for other in others:
        yield _row(path, OTHER, other.read_bytes(), reference)


def _row(path: Path, attack: str, data: bytes, reference: Reference) -> Row:
    surface, start = _surface(data), time.monotonic()
    try:
        aligned = align(surface, reference)
    except MeshmarkError as error:
        if error.code is not ErrorCode.DIFFERENT_MODEL:
            raise
        return Row(path.name, attack, round(time.monotonic() - start, 2))
    section, _ = compare(surface, data, aligned, reference, [])
    answers = [mark.present for mark in section.marks]
    counts = [answers.count(kind) for kind in (True, False, None)]
    return Row(path.name, attack, round(time.monotonic() - start, 2), section.residual, section.covered, *counts)


def _surface(data: bytes) -> Surface:
    return flatten(document_of(admit(data, DEFAULT_BUDGETS), DEFAULT_BUDGETS)).surface


def _moved(data: bytes) -> bytes:
    """A file's geometry turned, scaled and shifted."""
    surface = read_plain(data)
    turn = Rotation.from_rotvec([0.7, -1.9, 0.4]).as_matrix()
    world = surface.to_world(surface.positions) @ turn.T * 0.37 + np.array([1.0, -2.0, 3.0]) / surface.scale
    return plain_glb(Mesh(world, surface.faces))


if __name__ == "__main__":
    sys.exit(main())
