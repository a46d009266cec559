"""`make delivered MESHES=DIR`: how far the marks of every textured file of a folder are read as it is delivered.

Each asset is marked with default parameters, and OCR reads the pictures of the written file in its own materials; of
the same file it reads pictures of its plain geometry, grey clay as in the paper, too.
"""

import argparse
import multiprocessing
import sys
from collections import Counter
from functools import partial
from pathlib import Path

from core.errors import MeshmarkError
from core.formats.admission import admit, document_of
from core.gltf.scene import flatten, scene_of
from core.lab.plain import plain, plain_glb
from core.metrics.ocr import ocr
from core.metrics.recognition import Reader
from core.parameters import Parameters
from core.pipeline import watermark
from core.rendering.pictures import PICTURE_SIZE, pictures
from core.rendering.renderer import Renderer
from tests.survey import assets

TEXT = "watermark"
COLUMNS = (
    *("file", "OCR clay", "OCR as delivered", ">= 0.8", "marks", "least contrast", "colours"),
    *("SMSE", "IPE", "SE", "SE (Lee 2005)", "SS", "notices"),
)


def main() -> int:
    """Prints a row for each asset and their mean."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--color", action="append", help="instead of the preset's; several make a list")
    parser.add_argument("--only", action="append", help="start of a file's name; may be given several times")
    parser.add_argument("--out", type=Path, help="also write the GLB and the preview of every asset here")
    options = parser.parse_args()
    color = options.color[0] if options.color and len(options.color) == 1 else options.color and tuple(options.color)
    files = assets(options.folder, options.only)
    print(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}", flush=True)
    scores = []
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for found in pool.imap(partial(_delivered, color=color, out=options.out), files):
            if found is not None:
                row, score = found
                print(f"| {' | '.join(row)} |", flush=True)
                scores += [] if score is None else [score]
    if scores:
        print(f"\n{len(scores)} assets as delivered: mean {sum(scores) / len(scores):.3f}, least {min(scores):.3f}")
    return 0


def _clay(model: bytes) -> float:
    """OCR of the plain geometry of a GLB."""
    scene = scene_of(plain_glb(plain(scene_of(model).surface)))
    with Renderer(PICTURE_SIZE) as renderer:
        return ocr(pictures(scene, renderer), (TEXT,), Reader()).ratio


def _delivered(
    path: Path, color: str | tuple[str, ...] | None, out: Path | None
) -> tuple[list[str], float | None] | None:
    """The row of one asset and its OCR; None where it has no texture."""
    data = path.read_bytes()
    scene = flatten(document_of(admit(data)))
    if all(drawn.primitive.material.texture is None for drawn in scene.primitives):
        return None
    try:
        result = watermark(data, Parameters(text=TEXT, color=color), preview=out is not None)
    except MeshmarkError as error:
        return [path.name, f"{error.code}: {error.message}"], 0.0
    if out is not None:
        out.mkdir(exist_ok=True)
        (out / f"{path.stem}.glb").write_bytes(result.model)
        (out / f"{path.stem}.png").write_bytes(result.preview or b"")
    marks, metrics = result.report["watermarks"], result.report["metrics"]
    quality, utility = metrics["watermark_quality"], metrics["asset_utility"]
    distances = [mark["contrast"] for mark in marks if mark.get("contrast") is not None]
    colors = Counter(mark["color"] or "none" for mark in marks)
    row = [
        path.name,
        f"{_clay(result.model):.3f}",
        f"{quality['ocr']:.3f}",
        f"{quality['ocr_ge_0.8']:.2f}",
        str(len(marks)),
        f"{min(distances):.0f}" if distances else "",
        " ".join(f"{name} {count}" for name, count in colors.most_common()),
        *(f"{utility[name]:.4f}" for name in ("smse", "ipe", "se", "se_lee2005", "ss")),
        " ".join(notice["code"] for notice in result.report["warnings"]),
    ]
    return row, quality["ocr"]


if __name__ == "__main__":
    sys.exit(main())
