"""`make survey MESHES=DIR`: watermarks every file of a folder and prints one row of facts for each, as Markdown.

The letters are counted on the written file by rays and distances, independently of the code that embossed them.
"""

import argparse
import multiprocessing
import sys
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from manifold3d import triangulate

from core.artwork.outline import text_artwork
from core.choices import Evaluate
from core.errors import MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.spatial import SpatialIndex
from core.gltf.document import Document
from core.gltf.scene import flatten, scene_of
from core.parameters import Parameters
from core.pipeline import Result, watermark
from tests.validator import validate

ASSETS = {".glb", ".obj", ".stl", ".ply", ".off", ".zip", ".3mf"}
COLUMNS = (
    "file",
    "s",
    "read",
    "place",
    "emboss",
    "write",
    "marks",
    "verified / tried",
    "letters whole",
    "faces",
    "ipe",
    "lce",
    "ray",
    "coverage",
    "smse",
    "watertight",
    "open edges",
    "edges > 2 faces",
    "new glTF errors",
    "primitives touched",
    "MB",
    "peak MB",
)


def assets(folder: Path, only: list[str] | None = None) -> list[Path]:
    """The assets in a folder, in order of their names; those only whose names start with one of ``only``, if given."""
    starts = tuple(only) if only else ""
    return sorted(path for path in folder.iterdir() if path.suffix in ASSETS and path.name.startswith(starts))


def main() -> int:
    """Prints the table; returns the number of files on which something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, help="also write the GLB and the preview of every asset here")
    options = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}", flush=True)
    wrong = 0
    # A fresh process for each file: one asset's caches and warm code do not flatter the next one's times.
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        files = assets(options.folder)
        for row, bad in pool.imap(_survey, [(path, options.out) for path in files]):
            print(f"| {' | '.join(row)} |", flush=True)
            wrong += bad
    return wrong


def _survey(task: tuple[Path, Path | None]) -> tuple[list[str], bool]:
    path, out = task
    data = path.read_bytes()
    try:
        result = watermark(data, Parameters(text="watermark", evaluate=Evaluate.GEOMETRY), preview=out is not None)
    except MeshmarkError as error:
        return [path.name, f"{error.code}: {error.message}"], False
    if out is not None:
        out.mkdir(exist_ok=True)
        (out / f"{path.stem}.glb").write_bytes(result.model)
        (out / f"{path.stem}.png").write_bytes(result.preview or b"")
    report = result.report
    asset, model, seconds = report["asset"], report["model"], report["timings"]
    whole, letters = _whole_letters(data, result)
    errors = _errors(result.model) - (_errors(data) if asset["format"] == "glb" else 0)
    utility, quality = report["metrics"]["asset_utility"], report["metrics"]["watermark_quality"]
    same = all(asset[key] == model[key] for key in ("watertight", "boundary_edges", "nonmanifold_edges"))
    row = [
        path.name,
        f"{sum(seconds[stage] for stage in ('reading', 'lettering', 'placing', 'embossing', 'writing')):.2f}",
        *(f"{seconds[stage]:.2f}" for stage in ("reading", "placing", "embossing", "writing")),
        str(len(report["watermarks"])),
        f"{report['embossing']['verified']} / {report['embossing']['tried']}",
        f"{whole} / {letters}",
        f"{asset['faces']} -> {model['faces']}",
        str(utility["ipe"]),
        f"{utility['lce']:.1e}",
        f"{quality['ray']:.3f}",
        f"{quality['coverage']:.3f}",
        f"{utility['smse']:.4f}",
        *(f"{asset[key]} -> {model[key]}" for key in ("watertight", "boundary_edges", "nonmanifold_edges")),
        str(errors),
        _touched(data, result.model),
        f"{asset['bytes'] / 2**20:.2f} -> {model['bytes'] / 2**20:.2f}",
        f"{max(report['memory'].values()) / 2**20:.0f}",
    ]
    return row, not same or whole < letters or errors > 0 or utility["ipe"] != 0


def _touched(data: bytes, model: bytes) -> str:
    """How many of the input's mesh primitives came back changed, of how many; the others are equal byte for byte."""
    before = document_of(admit(data)).json["meshes"]
    after = Document.from_glb(model).json["meshes"]
    pairs = [
        pair
        for old, new in zip(before, after, strict=False)
        for pair in zip_longest(old["primitives"], new["primitives"][: len(old["primitives"])])
    ]
    return f"{sum(old != new for old, new in pairs)} / {len(pairs)}"


def _errors(glb: bytes) -> int:
    return int(validate(glb)["issues"]["numErrors"])


def _whole_letters(data: bytes, result: Result) -> tuple[int, int]:
    """How many letters stand whole, and how many there should be: near the point one relief above the original
    surface the written one must be raised, all over the letter."""
    original = flatten(document_of(admit(data))).surface
    written = scene_of(result.model).surface.in_frame_of(original)
    before = SpatialIndex(original.positions, original.faces)
    after = SpatialIndex(written.positions, written.faces)
    parameters: dict[str, Any] = result.report["parameters"]
    rings = text_artwork(parameters["text"]).rings
    corners = np.concatenate(rings)
    triangles = np.asarray(triangulate([np.ascontiguousarray(ring) for ring in rings]))
    # Points well inside the letters, and which letter each belongs to: the triangles of one letter share corners.
    inside = corners[triangles].mean(axis=1)
    label = np.arange(len(corners))
    for _ in range(len(corners)):
        lowest = label[triangles].min(axis=1)
        updated = label.copy()
        np.minimum.at(updated, triangles, lowest[:, None].repeat(3, axis=1))
        if np.array_equal(updated, label):
            break
        label = updated
    letter = label[triangles[:, 0]]
    whole = total = 0
    for mark in result.report["watermarks"]:
        center = (np.array(mark["center"]) - original.offset) * original.scale
        width, _, thickness = np.array(mark["size"]) * original.scale
        relief = mark["relief"] * original.scale
        right, up, normal = (np.array(mark[name]) for name in ("right", "up", "normal"))
        points = center + width * (inside[:, :1] * right + inside[:, 1:] * up)
        start = points + (thickness / 2 + relief) * normal
        distance, face = before.first_hit(start, np.broadcast_to(-normal, start.shape))
        feet = start - np.where(np.isfinite(distance), distance, 0.0)[:, None] * normal
        _, _, tops = after.closest(feet + relief * original.normals[face])
        off = before.closest(tops)[0]
        # Between its corners a flat top sags over a ridge; where a letter is missing nothing is raised at all.
        is_top = np.isfinite(distance) & (off > 0.25 * relief)
        for name in np.unique(letter):
            total += 1
            # Nine in ten: on a noisy scan single faces look sideways, and lead to the wrong place.
            whole += bool(is_top[letter == name].mean() > 0.9)
    return whole, total


if __name__ == "__main__":
    sys.exit(main())
