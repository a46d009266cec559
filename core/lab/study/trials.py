"""The trials of a study: assets that two methods marked, shown side by side without a name."""

import hashlib
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.bench import AssetBench
from core.lab.benchmark.datasets import Asset, load, stratified
from core.lab.benchmark.options import NO_ATTACK, BenchmarkOptions
from core.lab.benchmark.rows import Row
from core.lab.benchmark.select import ordered
from core.rendering.renderer import Renderer

SIDE = 480  # pixels of a picture
SUPERSAMPLING = 2  # samples a pixel and axis
LEVEL, ABOVE = 16, 8  # pictures around an asset, and around it from above
ELEVATIONS = (15, 50)  # degrees, of these
QUALITY = 80  # of WebP


@dataclass(frozen=True)
class Trial:
    """One asset as two methods marked it.

    Attributes:
        id: that says nothing about it.
        asset: its name in the dataset.
        textured: the asset's file has textures.
        delivered: it is shown in its own materials; else as grey clay, which is all that some methods leave.
        methods: of the first and the second of the two.
        original, first, second: pictures of the asset without marks and of the two, WebP, in the same order of views.
    """

    id: str
    asset: str
    textured: bool
    delivered: bool
    methods: tuple[str, str]
    original: tuple[bytes, ...]
    first: tuple[bytes, ...]
    second: tuple[bytes, ...]


def read_results(folder: Path) -> tuple[BenchmarkOptions, list[Row]]:
    """The options and the rows of a benchmark that was run.

    Raises:
        MeshmarkError: ``missing_file`` where there are none; ``malformed_file`` where they cannot be read.
    """
    path = folder / "results.json"
    if not path.is_file():
        raise MeshmarkError(
            ErrorCode.MISSING_FILE,
            f"{folder} holds no results of a benchmark (results.json).",
            "Give the folder that `meshmark benchmark --out` wrote.",
        )
    try:
        found = json.loads(path.read_bytes())
        asked: dict[str, Any] = found["options"]
        names = ("dataset", "split", "text", "size", "relief", "color", "seed")
        options = BenchmarkOptions(Path(asked["folder"]), folder, **{name: asked[name] for name in names})
        return options, ordered(found["rows"])
    except (ValueError, LookupError, TypeError) as error:
        raise MeshmarkError(
            ErrorCode.MALFORMED_FILE,
            f"{path} is not what a benchmark writes ({type(error).__name__}).",
            "Write it anew: meshmark benchmark --report-only.",
        ) from None


def chosen_rows(rows: Sequence[Row], methods: tuple[str, str], count: int | None) -> tuple[int, dict[str, Row]]:
    """The number of marks asked for, and by asset a row of the first method where both methods marked it so.

    Args:
        rows: of a benchmark.
        methods: that are compared.
        count: of marks; None: the middle one of those that both have.

    Raises:
        MeshmarkError: ``invalid_parameters`` where there is no asset that both marked.
    """
    by_method: dict[str, dict[tuple[int, str], Row]] = {
        method: {
            (row["count"], row["asset"]): row
            for row in rows
            if (row["method"], row["attack"], row["status"]) == (method, NO_ATTACK, "ok")
        }
        for method in methods
    }
    both = by_method[methods[0]].keys() & by_method[methods[1]].keys()
    counts = sorted({number for number, _ in both})
    if not counts or count not in (None, *counts):
        here = sorted({row["method"] for row in rows})
        marks = f" with {count} marks" if count is not None and counts else ""
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"No asset of this benchmark was marked{marks} both by {methods[0]!r} and by {methods[1]!r}.",
            f"Its methods are {', '.join(here)}" + (f", its numbers of marks {counts}." if counts else "."),
        )
    number = counts[len(counts) // 2] if count is None else count
    return number, {asset: by_method[methods[0]][number, asset] for each, asset in sorted(both) if each == number}


def trials(
    options: BenchmarkOptions, rows: Sequence[Row], methods: tuple[str, str], count: int | None, assets: int, seed: int
) -> Iterator[Trial]:
    """The trials over some of a benchmark's assets, each marked again as the benchmark did.

    Args:
        options, rows: of the benchmark, as :func:`read_results` gives them.
        methods: that are compared.
        count: of marks asked for; None: the middle one.
        assets: number of them, at most, drawn as evenly over their classes as these allow.
        seed: of that draw, and of the order of the methods in each trial.

    Raises:
        MeshmarkError: as :func:`chosen_rows`; ``missing_file`` where the assets are not there any longer.
    """
    number, wanted = chosen_rows(rows, methods, count)
    there = [asset for asset in load(options.folder, options.dataset, options.split).assets if asset.name in wanted]
    for missing in sorted(wanted.keys() - {asset.name for asset in there}):
        print(f"meshmark: {missing} is not in {options.folder} any longer; left out.", file=sys.stderr)
    rng = np.random.default_rng(seed)
    with Renderer(SIDE * SUPERSAMPLING) as renderer:
        for asset in stratified(there, assets, seed):
            turned = methods if rng.random() < 0.5 else (methods[1], methods[0])
            yield _trial(asset, wanted[asset.name], turned, number, options, renderer)


def _trial(
    asset: Asset, row: Row, methods: tuple[str, str], count: int, options: BenchmarkOptions, renderer: Renderer
) -> Trial:
    data = asset.path.read_bytes()
    bench = AssetBench(data, row["seed"], options)
    first, second = (bench.mark(method, count).marked for method in methods)
    delivered = first.delivered is not None and second.delivered is not None
    renderer.load(bench.delivered if delivered else bench.clay(bench.mesh))
    frame, original = renderer.frame, _pictures(renderer)
    shown = []
    for marked in (first, second):
        scene = marked.delivered if delivered else bench.clay(marked.mesh)
        assert scene is not None
        renderer.load(scene, frame)
        shown.append(_pictures(renderer))
    digest = hashlib.sha256(f"{row['sha256']} {' '.join(methods)} {options.seed}".encode()).hexdigest()
    return Trial(digest[:12], asset.name, row["textured"], delivered, methods, original, *shown)


def _pictures(renderer: Renderer) -> tuple[bytes, ...]:
    """Pictures of the asset that is loaded, around it and around it from above."""
    found = []
    for count, elevation in zip((LEVEL, ABOVE), np.radians(ELEVATIONS), strict=True):
        for azimuth in 2 * np.pi / count * np.arange(count):
            direction = (np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth))
            picture = Image.fromarray(renderer.render(direction, (0, 1, 0))).reduce(SUPERSAMPLING)
            file = BytesIO()
            picture.save(file, format="WEBP", quality=QUALITY)
            found.append(file.getvalue())
    return tuple(found)
