"""`make lighter MESHES=DIR`: what a preview model keeps of every file of a folder, beside the model itself."""

import argparse
import multiprocessing
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from core.choices import Evaluate
from core.errors import MeshmarkError
from core.parameters import Parameters
from core.pipeline import watermark
from core.preview_model import PreviewModel
from tests.survey import assets

COLUMNS = ("file", "triangles", "left", "kB", "preview kB", "marks", "preview marks", "OCR", "preview OCR", "SMSE", "s")


def main() -> int:
    """Prints a row for each asset and the means of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--triangles", type=int, default=PreviewModel().triangles)
    parser.add_argument("--evaluate", type=Evaluate, choices=list(Evaluate), default=Evaluate.FULL)
    parser.add_argument("--only", action="append", help="start of a file's name; may be given several times")
    parser.add_argument("--out", type=Path, help="also write both models of every asset here")
    options = parser.parse_args()
    asked = Parameters(
        text="PREVIEW", evaluate=options.evaluate, preview_model=PreviewModel(triangles=options.triangles)
    )
    print(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}", flush=True)
    rows = []
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        measured = partial(_measured, asked=asked, out=options.out)
        for name, found in pool.imap(measured, assets(options.folder, options.only)):
            cells = [found] if isinstance(found, str) else [_told(value) for value in found]
            print(f"| {' | '.join([name, *cells])} |", flush=True)
            rows += [] if isinstance(found, str) else [found]
    if rows:
        print(f"| mean of {len(rows)} | {' | '.join(map(_told, np.nanmean(rows, axis=0).tolist()))} |")
    return 0


def _told(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _measured(path: Path, asked: Parameters, out: Path | None) -> tuple[str, list[float] | str]:
    """The values of one asset, or why there are none."""
    try:
        result = watermark(path.read_bytes(), asked, preview=False)
    except MeshmarkError as error:
        return path.name, f"{error.code}: {error.message}"
    if result.preview_model is None:
        return path.name, result.report["warnings"][-1]["message"]
    if out is not None:
        out.mkdir(exist_ok=True)
        (out / f"{path.stem}.glb").write_bytes(result.model)
        (out / f"{path.stem}.preview.glb").write_bytes(result.preview_model)
    light = result.report["preview_model"]
    whole, own = result.report["metrics"] or {}, light["metrics"] or {}
    return path.name, [
        *(light["triangles_before"], light["triangles"]),
        *(len(result.model) / 1000, len(result.preview_model) / 1000),
        *(len(result.report["watermarks"]), len(light["watermarks"])),
        *(_value(each, "watermark_quality", "ocr") for each in (whole, own)),
        _value(own, "asset_utility", "smse"),
        light["seconds"],
    ]


def _value(metrics: dict[str, Any], kind: str, name: str) -> float:
    value = metrics.get(kind, {}).get(name)
    return np.nan if value is None else float(value)


if __name__ == "__main__":
    sys.exit(main())
