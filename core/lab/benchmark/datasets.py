"""The paper's datasets as they unpack on disk, and its stratified sample."""

import gzip
import json
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.errors import ErrorCode, MeshmarkError
from core.formats.format import Format

ENDINGS = {*(each.ending for each in Format), ".zip"}  # of files that are read
# Formats of a Meshy asset, in the order of preference where it was downloaded in several.
MESHY_FORMATS = (".glb", ".zip", ".obj", ".stl")
SYSTEM = ("__MACOSX", "Thumbs.db", "desktop.ini")


@dataclass(frozen=True)
class Asset:
    """One file of a dataset.

    Attributes:
        path: of the file.
        name: unique in its dataset: the path below the dataset's folder.
        kind: its class; empty where the dataset has none.
    """

    path: Path
    name: str
    kind: str


@dataclass(frozen=True)
class Dataset:
    """Assets found in a folder, in the order of the names.

    Attributes:
        assets: the files to watermark.
        notes: sentences about files that were left out.
    """

    assets: list[Asset]
    notes: list[str]


def load(folder: Path, layout: str, split: str) -> Dataset:
    """The assets of a dataset that is unpacked in ``folder``.

    Args:
        folder: the dataset's own folder, or the one it was unpacked in.
        layout: one of ``LAYOUTS``.
        split: ``train`` or ``test``, for the datasets that are split.

    Raises:
        MeshmarkError: ``missing_file`` where the folder holds nothing of that layout.
    """
    if not folder.is_dir():
        raise _nothing(folder, "does not exist or is not a folder", layout)
    dataset = LAYOUTS[layout](folder, split)
    if not dataset.assets:
        raise _nothing(folder, f"holds no asset in the layout of {layout}", layout)
    return dataset


def stratified(assets: list[Asset], count: int, seed: int) -> list[Asset]:
    """``count`` assets drawn at random without repetition, as evenly over the classes as their sizes allow.

    No class gets two more than another unless it is exhausted (paper, supplement "Datasets Statistics": "random
    sampling stratified by output classes"). The draw depends on the names and the seed only.

    Args:
        assets: to draw from.
        count: number to draw, at most.
        seed: of the draw.
    """
    rng = np.random.default_rng(seed)
    classes: dict[str, list[Asset]] = defaultdict(list)
    for asset in sorted(assets, key=lambda asset: asset.name):
        classes[asset.kind].append(asset)
    for kind in sorted(classes):
        order = rng.permutation(len(classes[kind]))
        classes[kind] = [classes[kind][row] for row in order]
    drawn: list[Asset] = []
    for turn in range(max(map(len, classes.values()), default=0)):
        open_classes = [kind for kind in sorted(classes) if len(classes[kind]) > turn]
        drawn += [classes[open_classes[row]][turn] for row in rng.permutation(len(open_classes))]
    return sorted(drawn[:count], key=lambda asset: asset.name)


def _nothing(folder: Path, problem: str, layout: str) -> MeshmarkError:
    remedy = (
        "Name a folder with assets in it, at any depth."
        if layout == "folder"
        else "Name the folder the dataset was unpacked in, and its layout with --dataset."
    )
    return MeshmarkError(ErrorCode.MISSING_FILE, f"{folder} {problem}.", remedy)


def _inner(folder: Path, name: str) -> Path:
    """``folder / name`` where the archive was unpacked in ``folder``, else ``folder``."""
    return folder / name if (folder / name).is_dir() else folder


def _visible(paths: Iterable[Path], root: Path) -> list[Path]:
    def hidden(path: Path) -> bool:
        parts = path.relative_to(root).parts
        return any(part.startswith(".") or part in SYSTEM for part in parts)

    return sorted((path for path in paths if path.is_file() and not hidden(path)), key=lambda path: path.as_posix())


def _assets(paths: Iterable[Path], root: Path, kind: Callable[[Path], str]) -> list[Asset]:
    return [Asset(path, path.relative_to(root).as_posix(), kind(path)) for path in paths]


def _ignored(paths: list[Path], why: str) -> list[str]:
    if not paths:
        return []
    names = ", ".join(path.name for path in paths[:3]) + (", ..." if len(paths) > 3 else "")
    return [f"{len(paths)} files ignored, {why}: {names}."]


def _folder(root: Path, _split: str) -> Dataset:
    """Any accepted file, at any depth; the first folder below the root is the class."""
    files = _visible(root.rglob("*"), root)
    known = [path for path in files if path.suffix.lower() in ENDINGS]
    other = [path for path in files if path.suffix.lower() not in ENDINGS]

    def kind(path: Path) -> str:
        parts = path.relative_to(root).parts
        return parts[0] if len(parts) > 1 else ""

    return Dataset(_assets(known, root, kind), _ignored(other, "not of a format Meshmark reads"))


def _classes(name: str, suffix: str) -> Callable[[Path, str], Dataset]:
    """``<name>/<class>/<train|test>/<file>``, as Manifold40 (SubdivNet) and ModelNet40 (Princeton) unpack."""

    def find(folder: Path, split: str) -> Dataset:
        root = _inner(folder, name)
        files = _visible(root.glob(f"*/{split}/*"), root)
        meshes = [path for path in files if path.suffix.lower() == suffix]
        other = [path for path in files if path.suffix.lower() != suffix]
        return Dataset(_assets(meshes, root, lambda path: path.parent.parent.name), _ignored(other, f"not {suffix}"))

    return find


def _objaverse(folder: Path, _split: str) -> Dataset:
    """``hf-objaverse-v1/glbs/<shard>/<uid>.glb``, with LVIS classes where the annotations are beside ``glbs``.

    The paper stratifies by class, so with annotations only annotated objects count. Objects are those on disk, hence
    ``object-paths.json.gz`` is not needed. Objaverse has no splits.
    """
    root = _inner(folder, "hf-objaverse-v1")
    files = _visible((root / "glbs").glob("*/*.glb"), root)
    kinds = _lvis(root)
    if not kinds:
        return Dataset(_assets(files, root, lambda _: ""), ["No LVIS annotations: all objects count as one class."])
    annotated = [path for path in files if path.stem in kinds]
    notes = [f"{len(files) - len(annotated)} objects without an LVIS class left out."]
    return Dataset(_assets(annotated, root, lambda path: kinds[path.stem]), notes * (len(annotated) < len(files)))


def _lvis(root: Path) -> dict[str, str]:
    """Class by uid; the alphabetically first one of an object that has several."""
    packed, plain = root / "lvis-annotations.json.gz", root / "lvis-annotations.json"
    try:
        if packed.is_file():
            annotations = json.loads(gzip.decompress(packed.read_bytes()))
        elif plain.is_file():
            annotations = json.loads(plain.read_bytes())
        else:
            return {}
        return {uid: kind for kind in sorted(annotations, reverse=True) for uid in annotations[kind]}
    except (OSError, EOFError, ValueError, TypeError) as error:
        raise MeshmarkError(
            ErrorCode.MALFORMED_FILE,
            f"The LVIS annotations in {root} cannot be read ({type(error).__name__}).",
            "Download lvis-annotations.json.gz again.",
        ) from error


def _meshy(root: Path, _split: str) -> Dataset:
    """Meshy's downloads: files side by side, or one folder an asset; one file of each asset counts, a GLB first."""
    files = _visible(root.rglob("*"), root)
    groups: dict[Path, list[Path]] = defaultdict(list)
    for path in files:
        if path.suffix.lower() in MESHY_FORMATS:
            below = path.relative_to(root).parts
            groups[root / below[0] if len(below) > 1 else path.with_suffix("")].append(path)
    chosen = [min(group, key=lambda path: MESHY_FORMATS.index(path.suffix.lower())) for group in groups.values()]
    other = sorted(set(files) - set(chosen))
    return Dataset(
        sorted(_assets(chosen, root, lambda _: ""), key=lambda asset: asset.name),
        _ignored(other, "textures, other formats of an asset, or unknown"),
    )


LAYOUTS: dict[str, Callable[[Path, str], Dataset]] = {
    "folder": _folder,
    "manifold40": _classes("Manifold40", ".obj"),
    "modelnet40": _classes("ModelNet40", ".off"),
    "objaverse": _objaverse,
    "meshy": _meshy,
}
