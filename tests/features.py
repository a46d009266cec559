"""`make features MESHES=DIR`: how many marks stand on the faces and features of the assets of a folder.

Each asset that `tests/data/features.json` knows, by the SHA-256 of its file, is marked with default parameters. A mark
touches a feature where the surface under its text reaches into the feature's box. The boxes were drawn by hand round
faces, eyes, ears, what is under a tail or between legs, logos, inscriptions, lamps and ornaments, tight enough in
depth that the back of a head is not in them; an asset without any is listed with none. A third of the assets, chosen by
their hashes, are `aside`: nothing was tuned on them.
"""

import argparse
import hashlib
import multiprocessing
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, TypeAdapter

from core.arrays import Bool, Float
from core.choices import Evaluate
from core.errors import MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes, unit_grid
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.gltf.scene import flatten
from core.parameters import Parameters
from core.pipeline import watermark
from tests.survey import assets

LABELS = Path(__file__).parent / "data" / "features.json"
GRID = (49, 17)  # points along a text and across it whose ground is looked at
REACH = 0.15  # of a text's longer side: how far its ground lies before or behind its plane, at most

Vector = tuple[float, float, float]


class Feature(BaseModel):
    """A box round a feature of an asset, in the asset's world coordinates.

    Attributes:
        kind: of feature.
        name: what it is.
        center: of the box.
        right: a unit vector along its width.
        up: a unit vector along its height; right x up is the direction it was looked at from.
        size: width, height and depth.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["face", "eye", "ear", "genitals", "logo", "inscription", "lamp", "ornament"]
    name: str
    center: Vector
    right: Vector
    up: Vector
    size: Vector


class Labelled(BaseModel):
    """An asset and its features.

    Attributes:
        file: its name.
        sha256: of the file.
        aside: nothing was tuned on it.
        features: may be none.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    file: str
    sha256: str
    aside: bool
    features: tuple[Feature, ...]


@dataclass(frozen=True)
class Touched:
    """The marks of one asset.

    Attributes:
        asset: its labels.
        marks: how many it carries.
        features: of each mark, the features that it touches.
        refused: the error in place of marks; empty where there was none.
    """

    asset: Labelled
    marks: int
    features: tuple[tuple[Feature, ...], ...]
    refused: str = ""

    @property
    def touching(self) -> int:
        """The number of marks that touch a feature."""
        return sum(bool(found) for found in self.features)


def labelled(path: Path = LABELS) -> dict[str, Labelled]:
    """The labelled assets by SHA-256."""
    assets = TypeAdapter(list[Labelled]).validate_json(path.read_bytes())
    return {asset.sha256: asset for asset in assets}


def boxes_of(items: Iterable[tuple[Vector, Vector, Vector, Vector]], surface: Surface) -> Boxes:
    """Boxes in the frame of a ``surface`` from centres, rights, ups and sizes in world coordinates."""
    rows = np.array([*items], dtype=np.float64).reshape(-1, 4, 3)
    axes = np.stack([rows[:, 1], rows[:, 2], np.cross(rows[:, 1], rows[:, 2])], axis=1)
    return Boxes(rows[:, 0], axes, rows[:, 3]).to_frame(surface.offset, surface.scale)


def ground(marks: Boxes, index: SpatialIndex) -> Float:
    """(B, N, 3) points of the surface under the text of each of B marks; of the text's plane where there is none."""
    grid = unit_grid(GRID) * marks.size[:, None, :2]
    plane = marks.center[:, None] + np.einsum("bnk,bkj->bnj", grid, marks.axes[:, :2])
    reach = REACH * marks.size[:, :2].max(axis=1)[:, None, None] * marks.axes[:, 2:]
    down = np.broadcast_to(-2 * reach, plane.shape)
    way, _ = index.first_hit((plane + reach).reshape(-1, 3), down.reshape(-1, 3))
    way = np.where(way <= 1, way, 0.5).reshape(plane.shape[:2])
    return np.asarray(plane + reach + way[..., None] * down)


def touching(marks: Boxes, features: Boxes, index: SpatialIndex) -> Bool:
    """(B, K) which of B marks touch which of K features of the surface."""
    offset = ground(marks, index)[:, None] - features.center[:, None]
    local = np.abs(np.einsum("bknj,kij->bkni", offset, features.axes))
    return np.asarray((local <= features.size[:, None] / 2).all(axis=3).any(axis=2))


def touched(data: bytes, asset: Labelled, marks: list[dict[str, Any]]) -> Touched:
    """The ``marks`` of a report and the features that they touch."""
    surface = flatten(document_of(admit(data))).surface
    texts = boxes_of(((mark["center"], mark["right"], mark["up"], mark["size"]) for mark in marks), surface)
    labels = boxes_of(((one.center, one.right, one.up, one.size) for one in asset.features), surface)
    table = touching(texts, labels, SpatialIndex(surface.positions, surface.faces))
    found = (tuple(one for one, hit in zip(asset.features, meets, strict=True) if hit) for meets in table.tolist())
    return Touched(asset, len(marks), tuple(found))


def row(found: Touched) -> str:
    """A line of Markdown on one asset."""
    kinds = Counter(kind for marks in found.features for kind in {one.kind for one in marks})
    names = sorted({one.name for marks in found.features for one in marks})
    cells = (
        found.asset.file + (" (aside)" if found.asset.aside else ""),
        str(len(found.asset.features)),
        found.refused or f"{found.touching} / {found.marks}",
        " ".join(f"{kind} {count}" for kind, count in sorted(kinds.items())),
        "; ".join(names),
    )
    return f"| {' | '.join(cells)} |"


def summary(all_found: list[Touched]) -> Iterator[str]:
    """A line for the assets that were tuned on, one for those aside, and one for each kind of feature."""
    for name, aside in (("tuned on", False), ("aside", True)):
        some = [found for found in all_found if found.asset.aside is aside]
        marks, on = sum(found.marks for found in some), sum(found.touching for found in some)
        yield f"{name}: {on} of {marks} marks on {len(some)} assets touch a feature ({on / max(marks, 1):.3f})"
    kinds = Counter(
        kind for found in all_found for marks in found.features for kind in {feature.kind for feature in marks}
    )
    yield "by kind: " + (", ".join(f"{kind} {count}" for kind, count in sorted(kinds.items())) or "none")


def measured(task: tuple[Path, Labelled], out: Path | None = None) -> Touched:
    """Marks an asset and finds what its marks touch; its GLB goes to the folder ``out``."""
    path, asset = task
    data = path.read_bytes()
    try:
        result = watermark(data, Parameters(text="watermark", evaluate=Evaluate.NONE), preview=False)
    except MeshmarkError as error:
        return Touched(asset, 0, (), f"{error.code}: {error.message}")
    if out is not None:
        out.mkdir(exist_ok=True)
        (out / f"{path.name}.glb").write_bytes(result.model)
    return touched(data, asset, result.report["watermarks"])


def main() -> int:
    """Prints a row for each asset and the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", action="append", help="start of a file's name; may be given several times")
    parser.add_argument("--out", type=Path, help="also write the GLB of every asset here")
    options = parser.parse_args()
    known, files = labelled(), []
    for path in assets(options.folder, options.only):
        asset = known.get(hashlib.sha256(path.read_bytes()).hexdigest())
        files += [] if asset is None else [(path, asset)]
    print("| file | features | marks that touch one | kinds | which |\n|" + " --- |" * 5, flush=True)
    all_found: list[Touched] = []
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for found in pool.imap(partial(measured, out=options.out), files):
            print(row(found), flush=True)
            all_found.append(found)
    print("", *summary(all_found), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
