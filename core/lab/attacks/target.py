"""Input of an attack besides the mesh, and its result."""

from dataclasses import dataclass, field

import numpy as np

from core.arrays import Bool, Float, Int
from core.geometry.boxes import Boxes
from core.geometry.edges import edge_table
from core.geometry.spatial import SpatialIndex
from core.gltf.scene import Scene
from core.lab.plain import Mesh

ON_SURFACE = 1e-3  # size-30 units of distance; a GLB's float32 rounds to 1e-6, the lowest relief is ten times as high


@dataclass(frozen=True, eq=False)
class Target:
    """The watermarked asset as known to its attacker, in the size-30 frame of the original: axes as in glTF, y up.

    Attributes:
        original_index: the surface without watermarks; only :mod:`core.lab.attacks.removal` queries it.
        boxes: of the B watermarks; only used to determine those that an attack leaves.
        rng: of every random draw; the same state gives the same attack.
        file: the marked file, whose faces are those of the mesh that is attacked; None where there is only the mesh.
            Only :mod:`core.lab.attacks.ladder` looks into it.
    """

    original_index: SpatialIndex
    boxes: Boxes
    rng: np.random.Generator
    file: Scene | None = None


@dataclass(frozen=True, eq=False)
class Attacked:
    """Result of an attack.

    Only a similarity without a mirror is a ``transform``, since boxes stay boxes under no other map. An attack that
    deforms the mesh, be it by a shear, is measured against the original in its place, as noise is.

    Attributes:
        mesh: in the size-30 frame of the original (axes as in glTF, y up), unless ``transform`` moves it out of it.
        kept: (B,) bool, the boxes whose watermark the attack did not cut away.
        transform: (4, 4) float64, the similarity that was applied to column vectors; the identity where the asset stays
            in its place.
        source: (F,) the face that each face of ``mesh`` was before, whose colour it has; -1 for the ground's. None
            where the attack does not say.
    """

    mesh: Mesh
    kept: Bool
    transform: Float = field(default_factory=lambda: np.eye(4))
    source: Int | None = None


def whole(mesh: Mesh, target: Target) -> Attacked:
    """An attack that stays in place and leaves every watermark where it was."""
    return Attacked(mesh, np.ones(len(target.boxes), dtype=bool))


def moved(mesh: Mesh, target: Target, transform: Float) -> Attacked:
    """``mesh`` and its watermarks under a (4, 4) similarity without a mirror."""
    positions = mesh.positions @ transform[:3, :3].T + transform[:3, 3]
    return Attacked(Mesh(positions, mesh.faces), np.ones(len(target.boxes), dtype=bool), transform)


def diagonal(mesh: Mesh) -> float:
    """Length of the bounding box's diagonal."""
    return float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))


def letter_faces(mesh: Mesh, original_index: SpatialIndex) -> Bool:
    """(F,) bool, the faces of letters: those with a vertex further than 1e-3 from the original surface, on the side
    that its mark stands out to most. The trench round smooth letters, on the other side, is ground."""
    distance, face, point = original_index.closest(mesh.positions)
    out = np.einsum("vi,vi->v", mesh.positions - point, original_index.normals(face))
    most = np.where(distance > ON_SURFACE, np.sign(out) * distance, 0)[mesh.faces]
    part = edge_table(mesh.faces).among(np.asarray(most.any(axis=1))).components()
    high, low = np.zeros(len(mesh.faces)), np.zeros(len(mesh.faces))
    np.maximum.at(high, part, most.max(axis=1))
    np.minimum.at(low, part, most.min(axis=1))
    side = np.where(high >= -low, 1.0, -1.0)[part]
    return np.asarray((side[:, None] * most > 0).any(axis=1))
