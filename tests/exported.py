"""Marks every file of a folder, writes the result in each format and prints what of the GLB is still there when that
is read again: ``python -m tests.exported FOLDER``."""

import html
import io
import sys
import time
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from core import exporting, marking
from core.arrays import Bool, Float
from core.choices import Evaluate, FileFormat
from core.errors import MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.format import Format
from core.formats.marked import coordinates
from core.geometry.products import product
from core.gltf.attributes import Points, interpolate_attribute
from core.gltf.base_color import base_color
from core.gltf.colors import srgb
from core.gltf.scene import Scene, flatten
from core.gltf.textures import texture_reader
from core.metrics.topology import topology
from core.parameters import Parameters
from core.stages import Asset, Exported, Output, Request, Run

SAMPLE = Parameters(text="SAMPLE", count=3, evaluate=Evaluate.NONE).resolved()
INSIDE = np.full((3, 3), 0.05) + 0.85 * np.eye(3)  # near each corner of a face, within it


@dataclass(frozen=True, eq=False)
class Seen:
    """Points near the corners of all faces: positions (P, 3) over the asset's side, sRGB (P, 3), UVs (P, 2) and whether
    a texture is drawn there (P,)."""

    positions: Float
    colors: Float
    uv: Float
    textured: Bool


def seen(scene: Scene, turn: Float) -> Seen:
    """The points of a scene whose axes are turned by a matrix (3, 3)."""
    surface, read = scene.surface, texture_reader(scene.document)
    world = product(surface.positions, turn.T)
    found: list[Seen] = []
    for drawn in scene.primitives:
        material, attributes = drawn.primitive.material, drawn.primitive.attributes
        rows = np.repeat(drawn.triangles, 3, axis=0)
        points = Points(rows, np.tile(INSIDE, (len(drawn.triangles), 1)))
        texture = None if material.texture is None else read(material.texture)
        colors = srgb(base_color(scene.document, material, texture, attributes, points)[:, :3])
        uv = np.full((len(rows), 2), np.nan)
        if "TEXCOORD_0" in attributes:
            uv = interpolate_attribute(scene.document, "TEXCOORD_0", attributes["TEXCOORD_0"], points)
            uv = product(uv, material.uv_transform[:, :2].T) + material.uv_transform[:, 2]
        at = Points(rows + drawn.first_vertex, points.barycentric).interpolate(world)
        found.append(Seen(at / 30, colors, uv, np.full(len(rows), texture is not None)))
    return Seen(
        np.concatenate([each.positions for each in found]),
        np.concatenate([each.colors for each in found]),
        np.concatenate([each.uv for each in found]),
        np.concatenate([each.textured for each in found]),
    )


@dataclass
class Tally:
    """Figures of one format over all assets."""

    files: int = 0
    seconds: list[float] = field(default_factory=list)
    moved: list[float] = field(default_factory=list)  # the farthest point, over the asset's side
    uv: list[float] = field(default_factory=list)  # share of points of the same ones, to 1e-6
    colors: list[float] = field(default_factory=list)  # share of points of the same colour, to 2 of 255
    materials: list[float] = field(default_factory=list)  # share of names
    names: list[float] = field(default_factory=list)
    edges: int = 0  # new non-manifold ones


def compare(tally: Tally, asset: Asset, output: Output, exported: Exported, seconds: float) -> str:
    """Add a written file to the figures of its format; returns a line about it."""
    before, after = output.scene, flatten(document_of(admit(exported.file.data)))
    turn = np.eye(3)
    if exported.file.format.inner is Format.STL and exported.unit:  # whose reader knows no axes
        turn = coordinates(asset.format, Format.STL).matrix[:3, :3].T / 1000
    if exported.file.format.inner is Format.THREEMF and not exported.unit:  # whose reader takes Z for up
        turn = coordinates(Format.GLB, Format.THREEMF).matrix[:3, :3] / 1000
    one, two = seen(before, np.eye(3)), seen(after, turn)
    near, which = KDTree(two.positions).query(one.positions)
    # Letters become plain where the others keep their texture.
    mapped = one.textured & ~np.isnan(one.uv[:, 0]) & (two.textured[which] | ~two.textured.any())
    tally.files += 1
    tally.seconds.append(seconds)
    tally.moved.append(float(near.max()))
    if mapped.any():
        off = np.abs(one.uv - two.uv[which])[mapped].max(axis=1)
        tally.uv.append(float((off <= 1e-6).mean()))
    alike = (np.abs(one.colors - two.colors[which]) <= 2 / 255 + 1e-9).all(axis=1)
    tally.colors.append(float(alike.mean()))
    text = _text(exported.file.data)
    for shares, names in ((tally.materials, _materials(before)), (tally.names, _nodes(before))):
        if names:
            shares.append(sum(" ".join(name.split()) in text for name in names) / len(names))
    edges = topology(after.surface).nonmanifold_edges - topology(before.surface).nonmanifold_edges
    tally.edges += max(edges, 0)
    return (
        f"  {exported.file.format:8} {seconds:6.2f} s {len(exported.file.data):12,} bytes  moved {near.max():.0e}  "
        f"colours {alike.mean():6.1%}  non-manifold {edges:+d}  left out: {', '.join(exported.left_out) or 'nothing'}"
    )


def _text(data: bytes) -> str:
    """All text in a file, or in those of an archive."""
    if not data.startswith(b"PK"):
        return data.decode("latin-1")
    archive = zipfile.ZipFile(io.BytesIO(data))
    return "".join(html.unescape(archive.read(name).decode("utf-8", "replace")) for name in archive.namelist())


def _materials(scene: Scene) -> set[str]:
    return {drawn.primitive.material.name for drawn in scene.primitives} - {""}


def _nodes(scene: Scene) -> set[str]:
    return {drawn.node.label for drawn in scene.primitives} - {"", "model"}


def marked(path: Path) -> tuple[Asset, Output]:
    """A file with three marks."""
    run = _run(FileFormat.GLB)
    asset = marking.read(path.read_bytes(), run.request.budgets, run.request.parameters.format)
    candidates = marking.place(asset, marking.letter(run), run)
    return asset, marking.write_model(asset, candidates.ground, marking.emboss(asset, candidates, run), run)


def _run(asked: FileFormat) -> Run:
    request = Request(SAMPLE.model_copy(update={"format": asked}), preview=False)
    return Run(request, lambda _share: None, lambda _name, _data: None)


def exports(asset: Asset, output: Output) -> Iterator[tuple[str, Exported, float]]:
    """The result in each format, by a name that tells the input's own, with the seconds that writing took."""
    for asked in (FileFormat.SAME, FileFormat.STL, FileFormat.OBJ, FileFormat.PLY, FileFormat.THREEMF):
        if asked is not FileFormat.SAME and str(asked) == str(asset.format.inner):
            continue
        start = time.process_time()
        try:
            exported = exporting.with_export(asset, output, _run(asked)).exported
        except MeshmarkError as error:
            print(f"  {asked:8} {error.code}")
            continue
        if exported is not None:
            name = exported.file.format.inner.upper()
            yield name + (" (its own)" if asked is FileFormat.SAME else ""), exported, time.process_time() - start


def main() -> None:
    """Print a line for each file and format, and the table."""
    tallies: dict[str, Tally] = {}
    for path in sorted(Path(sys.argv[1]).iterdir()):
        try:
            asset, output = marked(path)
        except MeshmarkError as error:
            print(f"{path.name}: {error.code}")
            continue
        print(f"{path.name}: {len(output.scene.surface.faces):,} faces", flush=True)
        for name, exported, seconds in exports(asset, output):
            print(compare(tallies.setdefault(name, Tally()), asset, output, exported, seconds), flush=True)
    print("\n| format | files | positions | UVs | colours | materials | names | new non-manifold edges | seconds |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for name, tally in sorted(tallies.items()):
        cells = (
            f"{max(tally.moved):.0e}",
            f"{np.mean(tally.uv):.1%}" if tally.uv else "-",
            f"{np.mean(tally.colors):.1%}",
            *(f"{np.mean(shares):.0%}" if shares else "-" for shares in (tally.materials, tally.names)),
            f"{tally.edges}",
            f"{np.median(tally.seconds):.2f}, at most {max(tally.seconds):.2f}",
        )
        print(f"| {name} | {tally.files} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
