"""`make labels MESHES=DIR`: how high the letters of a label are in pictures, for every file of a folder.

Each asset gets the label that is asked for (LABEL=cn by default) and nothing else; the metrics are those of its report.
"""

import argparse
import multiprocessing
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

from core.choices import Evaluate, Preset
from core.errors import MeshmarkError
from core.labels.profiles import Label
from core.parameters import Parameters
from core.pipeline import watermark
from tests.survey import assets

METRICS = ("label_height_share", "ray", "coverage", "prominence")
COLUMNS = ("file", "marks", "reached", *METRICS, "SMSE", "s")


def main() -> int:
    """Prints a row for each asset and the means of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--label", choices=[label.value for label in Label], default=Label.CHINA.value)
    parser.add_argument("--only", action="append", help="start of a file's name; may be given several times")
    parser.add_argument("--out", type=Path, help="also write the preview of every asset here")
    options = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}", flush=True)
    rows = []
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        measured = partial(_measured, label=Label(options.label), out=options.out)
        for name, found in pool.imap(measured, assets(options.folder, options.only)):
            cells = [found] if isinstance(found, str) else [f"{value:.3g}" for value in found]
            print(f"| {' | '.join([name, *cells])} |", flush=True)
            rows += [] if isinstance(found, str) else [found]
    if rows:
        print(f"| mean of {len(rows)} | {' | '.join(f'{value:.3g}' for value in np.nanmean(rows, axis=0))} |")
    return 0


def _measured(path: Path, label: Label, out: Path | None) -> tuple[str, list[float] | str]:
    """The values of one asset, or why there are none."""
    asked, start = Parameters(label=label, preset=Preset.PROVENANCE, evaluate=Evaluate.GEOMETRY), time.monotonic()
    try:
        result = watermark(path.read_bytes(), asked, preview=out is not None)
    except MeshmarkError as error:
        return path.name, f"{error.code}: {error.message}"
    seconds = time.monotonic() - start
    if out is not None:
        out.mkdir(exist_ok=True)
        (out / f"{path.stem}.png").write_bytes(result.preview or b"")
    metrics = result.report["metrics"]
    quality, utility = metrics["watermark_quality"], metrics["asset_utility"]
    values = [np.nan if quality[name] is None else float(quality[name]) for name in METRICS]
    reached = result.report["label"]["height_reached"]
    marks = float(len(result.report["watermarks"]))
    return path.name, [marks, np.nan if reached is None else reached, *values, float(utility["smse"]), seconds]


if __name__ == "__main__":
    sys.exit(main())
