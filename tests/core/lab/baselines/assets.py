"""Simple closed assets as prepared for the baselines, and what their results are checked by."""

import numpy as np

from core.arrays import Float
from core.choices import Preset
from core.geometry.surface import Surface
from core.lab.baselines.strategy import Marked, Prepared, prepare
from core.lab.plain import Mesh, plain, plain_glb
from core.metrics.topology import topology
from core.parameters import Parameters


def asset(shape: Surface, seed: int = 0) -> Prepared:
    """A shape of largest side 30 about the origin, with a short word."""
    return prepare(plain_glb(plain(shape)), "mark", seed)


def wanted(count: int, size: float = 4.0, seed: int = 0) -> Parameters:
    return Parameters(text="mark", preset=Preset.PAPER, size=size, count=count, seed=seed).resolved()


def watertight(mesh: Mesh) -> bool:
    return topology(mesh.surface()).watertight


def raised(prepared: Prepared, marked: Marked) -> tuple[Float, Float]:
    """Vertices that stand out of the original, and their distance to it."""
    distance, _, _ = prepared.index.closest(marked.mesh.positions)
    return marked.mesh.positions[distance > 1e-3], distance[distance > 1e-3]


def same(first: Mesh, second: Mesh) -> bool:
    return np.array_equal(first.positions, second.positions) and np.array_equal(first.faces, second.faces)
