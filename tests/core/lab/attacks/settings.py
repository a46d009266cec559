"""Meshes and targets that the tests of several attacks share."""

import numpy as np

from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.lab.attacks.target import Target
from core.lab.plain import Mesh, plain


def mesh_of(surface: Surface) -> Mesh:
    return plain(surface)


def target_of(mesh: Mesh, seed: int = 0, boxes: Boxes | None = None) -> Target:
    nothing = Boxes.empty()
    index = SpatialIndex(mesh.positions, mesh.faces)
    return Target(index, nothing if boxes is None else boxes, np.random.default_rng(seed))


def boxes_at(*centers: tuple[float, float, float]) -> Boxes:
    """Boxes of 0.2 x 0.1 x 0.1 with the axes of the frame."""
    count = len(centers)
    return Boxes(np.array(centers), np.tile(np.eye(3), (count, 1, 1)), np.tile([0.2, 0.1, 0.1], (count, 1)))


def area(mesh: Mesh) -> float:
    return float(mesh.surface().areas.sum())


def volume(mesh: Mesh) -> float:
    """Enclosed volume, positive where faces look outwards."""
    a, b, c = (mesh.positions[mesh.faces[:, corner]] for corner in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)
