"""`make verified MESHES=DIR`: how surely marks are read back from every file of a folder, by attack.

Each asset is marked with default parameters and without a colour, and verified with the known text. The one without is
also attacked: attacks keep the shape alone. The asset without marks is a negative, as are screenshots of it. A row is
printed as each is done, and the rates at the end.
"""

import argparse
import io
import json
import multiprocessing
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from PIL import Image

from core.budgets import DEFAULT_BUDGETS
from core.choices import Evaluate
from core.errors import MeshmarkError
from core.formats.admission import admit, document_of
from core.gltf.scene import Scene, flatten, scene_of
from core.lab.attacks.attack import attack_file
from core.parameters import Parameters
from core.pipeline import watermark
from core.rendering.pictures import DIRECTIONS, UPS, pictures
from core.rendering.renderer import Renderer
from core.verify.verify import verify
from tests.survey import assets

TEXT = "watermark"
COLORS = {"colours": None, "no colour": "none"}
UNTOUCHED, UNMARKED = "untouched", "unmarked"
ATTACKS: dict[str, tuple[str, float | None]] = {
    "crop": ("crop", None),
    "rotate": ("rotate", None),
    "scale": ("scale", None),
    "reexport": ("reexport", None),
    "decimate 0.5": ("decimate", 0.5),
    "subdivide": ("subdivide", None),
    "remesh 1/256": ("remesh", 1 / 256),
    "remesh 1/128": ("remesh", 1 / 128),
    "remesh 1/64": ("remesh", 1 / 64),
    "noise": ("noise", None),
    "removal": ("removal", None),
}
SCREENSHOTS = "screenshots"  # of 512 pixels, JPEG of quality 70
Row = tuple[str, str, str, bool | None, int, float]  # file, attack, colour, found, marks, seconds


def main() -> int:
    """Prints a row for each verification, and the share found by attack and colour."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", action="append", help="start of a file's name; may be given several times")
    known = ", ".join([*ATTACKS, SCREENSHOTS])
    parser.add_argument("--attacks", default="", help=f"of {known}; with commas between them")
    options = parser.parse_args()
    attacks = [name.strip() for name in options.attacks.split(",") if name.strip()]
    found: dict[tuple[str, str], list[bool]] = defaultdict(list)
    seconds = []
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for rows in pool.imap(partial(_verified, attacks=attacks), assets(options.folder, options.only)):
            for row in rows:
                print(json.dumps(row, ensure_ascii=False), flush=True)
                _, attack, color, outcome, _, spent = row
                seconds.append(spent)
                if outcome is not None:
                    found[attack, color].append(outcome)
    print("\n| attack | marks | found |\n| --- | --- | --- |")
    for (attack, color), outcomes in found.items():
        print(f"| {attack} | {color} | {sum(outcomes)} of {len(outcomes)} |")
    print(f"\n{sorted(seconds)[len(seconds) // 2]:.1f} s in the median, {max(seconds):.1f} s at most")
    return 0


def _verified(path: Path, attacks: list[str]) -> list[Row]:
    """The outcomes of one asset; None where it could not be marked or attacked."""
    return list(_rows(path, path.read_bytes(), attacks))


def _rows(path: Path, data: bytes, attacks: list[str]) -> Iterator[Row]:
    yield _row(path, UNMARKED, "-", data)
    if SCREENSHOTS in attacks:
        scene = flatten(document_of(admit(data, DEFAULT_BUDGETS), DEFAULT_BUDGETS))
        yield from _screenshots(path, f"{UNMARKED}, {SCREENSHOTS}", "-", scene)
    for name, color in COLORS.items():
        parameters = Parameters(text=TEXT, color=color, evaluate=Evaluate.NONE)
        try:
            marked = watermark(data, parameters, preview=False).model
        except MeshmarkError:
            yield path.name, UNTOUCHED, name, None, 0, 0.0
            continue
        yield _row(path, UNTOUCHED, name, marked)
        if SCREENSHOTS in attacks:
            yield from _screenshots(path, SCREENSHOTS, name, scene_of(marked))
        if color is None:
            continue
        for attack in attacks:
            if attack != SCREENSHOTS:
                yield _attacked(path, attack, name, marked, data)


def _attacked(path: Path, attack: str, color: str, marked: bytes, data: bytes) -> Row:
    kind, strength = ATTACKS[attack]
    try:
        attacked = attack_file(marked, kind, strength, 0, data)
    except MeshmarkError:
        return path.name, attack, color, None, 0, 0.0
    return _row(path, attack, color, attacked)


def _screenshots(path: Path, attack: str, color: str, scene: Scene) -> Iterator[Row]:
    """A row for each of four screenshots from the sides, as a phone takes them."""
    with Renderer(512) as renderer:
        shown = pictures(scene, renderer, DIRECTIONS[12::3], UPS[12::3])
    for picture in shown:
        file = io.BytesIO()
        Image.fromarray(picture).save(file, "JPEG", quality=70)
        yield _row(path, attack, color, file.getvalue())


def _row(path: Path, attack: str, color: str, data: bytes) -> Row:
    start = time.monotonic()
    report = verify(data, [TEXT]).report
    return path.name, attack, color, bool(report["found"]), len(report["marks"]), round(time.monotonic() - start, 1)


if __name__ == "__main__":
    sys.exit(main())
