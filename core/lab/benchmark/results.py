"""``results.csv`` and ``results.json``: every row, flat for a spreadsheet and whole for a program."""

import csv
import io
import json
import platform
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from core import __version__
from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.options import BenchmarkOptions
from core.lab.benchmark.rows import Row

SCHEMA = "meshmark.benchmark/1"
LIBRARIES = ("embreex", "libigl", "manifold3d", "numpy", "onnxruntime", "pyrender", "scipy", "torch", "trimesh")
# First the columns that every row has, in reading order; metrics and seconds follow.
COLUMNS = (
    "dataset", "asset", "kind", "method", "count", "attack", "strength", "status", "code", "message",
    "vertices", "faces", "marks", "survived", "bit_accuracy",
)  # fmt: skip
LAST = ("spent", "seed", "version", "machine", "sha256", "key")


def write_results(rows: list[Row], options: BenchmarkOptions) -> None:
    """Write both files into ``options.out``; raises ``output_not_writable``."""
    write_text(options.out / "results.csv", table(rows))
    whole = {
        "schema": SCHEMA,
        "options": json.loads(json.dumps(asdict(options), default=str)),
        "environment": environment(),
        "rows": rows,
    }
    write_text(options.out / "results.json", json.dumps(whole, indent=1, sort_keys=True) + "\n")


def table(rows: list[Row]) -> str:
    """The rows as CSV: one line each, metrics by name, seconds as ``seconds_<stage>``; missing values are empty."""
    flat = [flatten(row) for row in rows]
    found = dict.fromkeys(name for row in flat for name in row)
    between = [name for name in found if name not in COLUMNS + LAST]
    output = io.StringIO()
    writer = csv.DictWriter(output, [*COLUMNS, *between, *LAST], restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return output.getvalue()


def flatten(row: Row) -> dict[str, Any]:
    """A row with its metrics, seconds and settings beside its other columns."""
    nested = ("metrics", "seconds", "settings", "missing")
    flat: dict[str, Any] = {name: value for name, value in row.items() if name not in nested}
    seconds: dict[str, Any] = {f"seconds_{name}": value for name, value in row.get("seconds", {}).items()}
    metrics: dict[str, Any] = row.get("metrics", {})
    return {**flat, **metrics, **seconds, **row["settings"]}


def environment() -> dict[str, Any]:
    """Versions and platform that a run's numbers depend on beside the options."""
    versions: dict[str, str | None] = {}
    for name in LIBRARIES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = None
    return {"meshmark": __version__, "python": platform.python_version(), "platform": platform.platform()} | versions


def write_text(path: Path, text: str) -> None:
    """Write beside the target and rename, so that no half-written file is ever left under its name."""
    partial = path.with_name(path.name + ".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise MeshmarkError(
            ErrorCode.OUTPUT_NOT_WRITABLE, f"{path} cannot be written: {error.strerror}.", "Choose another --out."
        ) from None
