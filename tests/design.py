"""`make design MESHES=DIR`: how far the marks of every file of a folder stand where a designer would put them.

Faults are counted on the original surface by rays from the boxes of the report, independently of the code that placed
them. Lengths are in text heights, angles in degrees; see :class:`Faults`.
"""

import argparse
import json
import multiprocessing
import sys
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path

import numpy as np
from scipy.ndimage import label, uniform_filter

from core.analysis.analyse import eye_index
from core.arrays import Bool, Float, Int
from core.artwork.outline import text_artwork
from core.artwork.raster import raster
from core.choices import Evaluate, Preset
from core.errors import MeshmarkError
from core.evaluate import to_boxes
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes, unit_grid
from core.geometry.spatial import Eye, SpatialIndex
from core.geometry.triangles import unit
from core.gltf.scene import flatten
from core.parameters import Parameters
from core.pipeline import watermark
from core.placement.candidates import POLE, upright
from core.report import Places
from tests.survey import assets

TEXT = "watermark"
FINE = 12  # rays a text height under a mark
JUMP = 13.0  # between neighbours of these rays, the normals averaged over three by three: ground of its own beyond
TURNED = 25.0  # of one ground against the one that holds most of the letters: folded beyond
FOLDED = 0.1  # share of the letters on such ground, from which on a mark is folded
REACH, STEP = 2.0, 0.1  # how far margins are looked for, and how finely
STEEP = np.cos(np.radians(50.0))  # ground turned further than this is no margin
CRAMPED, UNEVEN = 0.5, 0.5  # a margin less than the one, and so much less than the opposite one
SLANT = 7.0  # off the level or the plumb line
ALIKE = np.cos(np.radians(30.0))  # marks that look so far the same way stand on one face
PARALLEL = np.cos(np.radians(10.0))
LARGEST, GROWTH = 0.8, 1.1  # size-30 units: height of the largest text, and the ratio of heights that are tried
COLUMNS = (
    "file",
    "s",
    "marks",
    "folded",
    "rim",
    "margin",
    "slanted",
    "idle",
    "stacked",
    "ragged",
    "room",
    "ray",
    "cov",
)


@dataclass(frozen=True)
class Faults:
    """The faults of the marks of one asset, each (B,).

    Attributes:
        folded: share of the letters on ground turned away by a jump, not a bend.
        margin: least way from a mark to where its ground ends, at most ``REACH``.
        rim: less margin on one side than on the other, although the mark had room to move.
        slanted: neither level nor plumb on ground that has an up.
        idle: slanted where level text of the same size had room.
        stacked: a line above or below another one on the same face.
        ragged: beside another mark on the same face, but not on its baseline.
        room: height over the greatest that fits at this place, at any turn.
    """

    folded: Float
    margin: Float
    rim: Bool
    slanted: Bool
    idle: Bool
    stacked: Bool
    ragged: Bool
    room: Float


@dataclass(frozen=True, eq=False)
class Ground:
    """What rays against a box's normal meet: its height over the middle plane, -inf for nothing, and its normal."""

    height: Float
    normal: Float


def cast(index: SpatialIndex, normals: Float, boxes: Boxes, local: Float) -> Ground:
    """Ground under points (B, N, 2) in text heights, from one height above each box."""
    clearance = boxes.size[:, 2] / 2 + boxes.size[:, 1]
    plane = local * boxes.size[:, None, 1:2]
    points = np.concatenate([plane, np.broadcast_to(clearance[:, None, None], (*plane.shape[:2], 1))], axis=2)
    start = np.einsum("bni,bij->bnj", points, boxes.axes) + boxes.center[:, None]
    down = np.broadcast_to(-boxes.axes[:, None, 2], start.shape)
    distance, face = index.first_hit(start.reshape(-1, 3), down.reshape(-1, 3), Eye.ORIGIN)
    met = (face >= 0).reshape(start.shape[:2])
    normal = np.where(met[..., None], normals[face].reshape(start.shape), 0.0)
    normal *= np.where(np.einsum("bni,bi->bn", normal, boxes.axes[:, 2]) < 0, -1.0, 1.0)[..., None]  # drawn from behind
    return Ground(np.where(met, clearance[:, None] - distance.reshape(met.shape), -np.inf), normal)


def holds(boxes: Boxes, ground: Ground, steep: float = float(STEEP)) -> Bool:
    """(B, N) rays that meet, within the box, ground that looks its way."""
    level = np.abs(ground.height) <= boxes.size[:, 2:3] / 2
    return np.asarray(level & (np.einsum("bni,bi->bn", ground.normal, boxes.axes[:, 2]) > steep))


def faults(boxes: Boxes, index: SpatialIndex, normals: Float, text: str = TEXT) -> Faults:
    """The faults of marks of a ``text`` in one line, in ``boxes`` (B) on a surface with unit face ``normals``."""
    turn = np.degrees(np.arcsin(np.clip((boxes.axes[:, 0] * upright(boxes.axes[:, 2])[:, 1]).sum(axis=1), -1, 1)))
    has_up = np.abs(boxes.axes[:, 2, 1]) < POLE
    slanted = has_up & (np.abs(turn) > SLANT) & (np.abs(turn) < 90 - SLANT)
    margins = _margins(boxes, index, normals)
    least, most = margins.min(axis=2), margins.max(axis=2)
    stacked, ragged = _pairs(boxes)
    return Faults(
        folded=_folded(boxes, index, normals, text),
        margin=margins.min(axis=(1, 2)),
        rim=((least < CRAMPED) & (most - least > UNEVEN)).any(axis=1),
        slanted=slanted,
        idle=slanted & _fits(Boxes(boxes.center, upright(boxes.axes[:, 2]), boxes.size), index, normals),
        stacked=stacked,
        ragged=ragged,
        room=_room(boxes, index, normals),
    )


def _folded(boxes: Boxes, index: SpatialIndex, normals: Float, text: str) -> Float:
    folded = np.zeros(len(boxes))
    for number in range(len(boxes)):
        one = boxes[number : number + 1]
        aspect = one.size[0, 0] / one.size[0, 1]
        shape = round(FINE * aspect), FINE
        ground = cast(index, normals, one, (unit_grid(shape) * (aspect, 1.0))[None])
        normal = ground.normal.reshape(*shape, 3)
        mean = unit(uniform_filter(normal, size=(3, 3, 1), mode="nearest").reshape(-1, 3)).reshape(normal.shape)
        ink = raster(text_artwork(text), shape[0] * 4)
        rows = (np.arange(shape[1]) * (len(ink) - 1) / (shape[1] - 1)).round().astype(int)
        columns = (np.arange(shape[0]) * (ink.shape[1] - 1) / (shape[0] - 1)).round().astype(int)
        letters = ink[np.ix_(rows, columns)].T
        piece = _pieces(mean, float(np.cos(np.radians(JUMP))))
        share = np.bincount(piece[letters], minlength=piece.max() + 1)
        total = unit(np.stack([np.bincount(piece.ravel(), normal[..., axis].ravel()) for axis in range(3)], axis=1))
        away = total @ total[share.argmax()] < np.cos(np.radians(TURNED))
        folded[number] = share[away].sum() / max(share.sum(), 1)
    return folded


def _pieces(normal: Float, cosine: float) -> Int:
    """(W, H) number of the piece of ground that each ray meets; within one, neighbours' normals are alike."""
    wide, high = normal.shape[:2]
    alike = np.ones((2 * wide - 1, 2 * high - 1), dtype=bool)
    alike[1::2, ::2] = (normal[1:] * normal[:-1]).sum(axis=2) > cosine
    alike[::2, 1::2] = (normal[:, 1:] * normal[:, :-1]).sum(axis=2) > cosine
    alike[1::2, 1::2] = False
    return np.asarray(label(alike)[0][::2, ::2] - 1)


def _margins(boxes: Boxes, index: SpatialIndex, normals: Float) -> Float:
    """(B, 2, 2) margins left and right, below and above."""
    away = np.arange(STEP, REACH + STEP / 2, STEP)
    margins = np.zeros((len(boxes), 2, 2))
    half = boxes.size[:, :2] / boxes.size[:, 1:2] / 2
    for axis in (0, 1):
        along = np.linspace(-1, 1, (9, 25)[axis])
        for side, sign in enumerate((-1, 1)):
            local = np.zeros((len(boxes), len(away), len(along), 2))
            local[..., axis] = sign * (half[:, axis, None] + away)[:, :, None]
            local[..., 1 - axis] = half[:, 1 - axis, None, None] * along
            met = holds(boxes, cast(index, normals, boxes, local.reshape(len(boxes), -1, 2)))
            bad = met.reshape(len(boxes), len(away), -1).mean(axis=2) < 0.9
            margins[:, axis, side] = np.where(bad.any(axis=1), bad.argmax(axis=1) * STEP, REACH)
    return margins


def _pairs(boxes: Boxes) -> tuple[Bool, Bool]:
    """(B,) marks in a stack, and (B,) marks beside another that are off its baseline."""
    offset = boxes.center[None] - boxes.center[:, None]
    along, across, off = (np.einsum("abi,ai->ab", offset, boxes.axes[:, axis]) for axis in range(3))
    width, height = boxes.size[:, 0], boxes.size[:, 1]
    face = (boxes.axes[:, 2] @ boxes.axes[:, 2].T > ALIKE) & ~np.eye(len(boxes), dtype=bool)
    face &= np.abs(off) < np.maximum(height[:, None], height)
    level = boxes.axes[:, 0] @ boxes.axes[:, 0].T
    gap = np.abs(along) - (width[:, None] + width) / 2
    taller = np.maximum(height[:, None], height)
    over = gap < -0.3 * np.minimum(width[:, None], width)
    stacked = face & (np.abs(level) > PARALLEL) & over & (np.abs(across) < 4 * taller)
    # Letters stand on their baselines, wherever the middles of the lines are.
    base = np.abs(across + height[:, None] / 2 - height / 2)
    beside = face & (gap > 0) & (gap < np.maximum(width[:, None], width)) & (np.abs(across) < taller)
    ragged = beside & ((base > 0.1 * taller) | (np.abs(level) < np.cos(np.radians(3.0))))
    return (stacked | stacked.T).any(axis=1), (ragged | ragged.T).any(axis=1)


def _fits(boxes: Boxes, index: SpatialIndex, normals: Float) -> Bool:
    """(B,) boxes with ground under all of them, where they are or half a height up or down."""
    grid = unit_grid((13, 4)) * 1.05
    fits = np.zeros(len(boxes), dtype=bool)
    for shift in (0.0, -0.5, 0.5):
        local = grid * (boxes.size[:, None, :2] / boxes.size[:, None, 1:2]) + (0.0, shift)
        fits |= holds(boxes, cast(index, normals, boxes, local)).all(axis=1)
    return fits


def _room(boxes: Boxes, index: SpatialIndex, normals: Float) -> Float:
    """(B,) see :class:`Faults`."""
    room, turns = np.ones(len(boxes)), np.radians(np.arange(0, 180, 7.5))
    for number in range(len(boxes)):
        one = boxes[number : number + 1]
        sizes = GROWTH ** np.arange(1, 1 + max(np.log(LARGEST / one.size[0, 1]) / np.log(GROWTH), 0))
        right, up, normal = one.axes[0]
        turned = np.stack(
            [
                np.stack([c * right + s * up, c * up - s * right, normal])
                for c, s in zip(np.cos(turns), np.sin(turns), strict=True)
            ]
        )
        for size in sizes:
            larger = Boxes(np.repeat(one.center, len(turns), 0), turned, np.repeat(one.size * size, len(turns), 0))
            if not _fits(larger, index, normals).any():
                break
            room[number] = size
    return np.asarray(1 / room)


def main() -> int:
    """Prints a row for each asset, and their means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", action="append", help="start of a file's name; may be given several times")
    parser.add_argument("--preset", type=Preset, default=Preset.MERCHANDISE, choices=list(Preset))
    parser.add_argument("--out", type=Path, help="also write the report and the preview of every asset here")
    options = parser.parse_args()
    files = assets(options.folder, options.only)
    print(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}", flush=True)
    found = []
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for name, row in pool.imap(partial(_designed, preset=options.preset, out=options.out), files):
            if isinstance(row, str):
                print(f"| {name} | {row} |", flush=True)
                continue
            found.append(row)
            print(_line(name, row), flush=True)
    if found:
        print(_line("mean", np.mean(found, axis=0)))
    return 0


def _line(name: str, row: Float) -> str:
    return (
        f"| {name} | "
        + " | ".join(f"{value:.{digits}f}" for value, digits in zip(row, (2, 1, *[3] * 10), strict=True))
        + " |"
    )


def _designed(path: Path, preset: Preset, out: Path | None) -> tuple[str, Float | str]:
    data = path.read_bytes()
    try:
        result = watermark(
            data, Parameters(text=TEXT, preset=preset, evaluate=Evaluate.GEOMETRY), preview=out is not None
        )
    except MeshmarkError as error:
        return path.name, f"{error.code}: {error.message}"
    if out is not None:
        out.mkdir(exist_ok=True)
        (out / f"{path.stem}.json").write_text(json.dumps(result.report))
        (out / f"{path.stem}.png").write_bytes(result.preview or b"")
    report = result.report
    scene = flatten(document_of(admit(data)))
    surface, index = eye_index(scene, scene.surface)
    boxes, _ = to_boxes(Places.model_validate(report).watermarks, surface)
    found = faults(boxes, index, surface.normals)
    quality = report["metrics"]["watermark_quality"]
    values = {each.name: getattr(found, each.name) for each in fields(Faults)}
    values["folded"] = values["folded"] > FOLDED
    shown = ("folded", "rim", "margin", "slanted", "idle", "stacked", "ragged", "room")
    return path.name, np.array(
        [
            report["timings"]["placing"],
            len(boxes),
            *(values[name].mean() for name in shown),
            quality["ray"],
            quality["coverage"],
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
