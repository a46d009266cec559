"""A bench whose every value is known, and which fails where an asset's name asks for it."""

import os
import signal
import time
from pathlib import Path
from typing import Any

from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.datasets import Asset
from core.lab.benchmark.options import AttackRequest, BenchmarkOptions
from core.lab.benchmark.rows import Row, combinations, key


class FakeBench:
    """Rows at once; trouble by the asset's name."""

    def __init__(self, asset: Asset, seed: int) -> None:
        self.name = asset.path.stem
        self.seed = seed

    def facts(self) -> Row:
        return {"vertices": 100, "faces": 200, "bytes": 3}

    def mark(self, method: str, count: int) -> Any:
        if self.name == "refused" and method == "li":
            raise MeshmarkError(ErrorCode.NOT_MANIFOLD, "It has a hole.", "Close it.")
        if self.name == "crashing" and (method, count) == ("li", 4):
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.name == "buggy" and method == "li":
            raise ZeroDivisionError("by zero")
        return method, count

    def measure(self, marked: Any, attack: AttackRequest) -> Row:
        if self.name == "hanging" and marked == ("li", 4) and attack.name == "crop":
            time.sleep(60)
        if self.name.startswith("slow"):
            time.sleep(0.15)
        return {"marks": marked[1], "metrics": {"wps": 0.5}, "missing": {}, "seconds": {"run": 1.0}, "seen": self.seed}


def open_fake(asset: Asset, seed: int, _options: BenchmarkOptions) -> FakeBench:
    if asset.path.stem == "unreadable":
        raise MeshmarkError(ErrorCode.MALFORMED_FILE, "It is no mesh.", "Send a mesh.")
    if asset.path.stem == "fatal":
        os._exit(3)
    return FakeBench(asset, seed)


def options(tmp_path: Path, *names: str, **changes: Any) -> BenchmarkOptions:
    """Options for a folder with one small file for each name."""
    folder = tmp_path / "meshes"
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / f"{name}.obj").write_text(name)
    given: dict[str, Any] = {
        "methods": ("meshmark", "li"),
        "counts": (4, 16),
        "attacks": (AttackRequest("crop", 0.5),),
        "attack_counts": (4,),
        "level": Evaluate.GEOMETRY,
    }
    return BenchmarkOptions(folder, tmp_path / "out", **given | changes)


def expected(rows: list[Row], asked: BenchmarkOptions) -> set[str]:
    """The keys that a finished run over the assets of ``rows`` must have."""
    assets = {(row["sha256"], row["seed"]) for row in rows}
    return {key(one.identity(*asset, asked)) for asset in assets for one in combinations(asked)}
