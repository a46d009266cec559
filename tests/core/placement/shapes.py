"""More small surfaces whose answers are known by hand, and boxes to put on them."""

import numpy as np

from core.analysis.facts import Carrier
from core.arrays import Bool, Float
from core.artwork.artwork import Artwork
from core.artwork.layouts import Layouts
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.placement.filters import FACING
from core.placement.nearest import TangentPlanes
from tests.core.shapes import join as join
from tests.core.shapes import surface as surface

IDENTITY = np.eye(3)


def index_of(shape: Surface) -> SpatialIndex:
    return SpatialIndex(shape.positions, shape.faces)


def planes_of(shape: Surface) -> TangentPlanes:
    index = index_of(shape)
    return TangentPlanes(shape, shape.normals, index, FACING, index)


def carrier(shape: Surface, cuttable: Bool | None = None) -> Carrier:
    """A shape of one component, all of whose faces may carry text where none are named."""
    count = len(shape.faces)
    usable = np.ones(count, dtype=bool) if cuttable is None else cuttable
    return Carrier(shape, index_of(shape), usable, np.zeros(count, dtype=np.int64))


def moved(shape: Surface, rotation: Float = IDENTITY, shift: Float | tuple[float, float, float] = (0, 0, 0)) -> Surface:
    return surface(shape.positions @ rotation.T + np.asarray(shift), shape.faces)


def inside_out(shape: Surface) -> Surface:
    return surface(shape.positions, shape.faces[:, ::-1])


def plane(width: float, height: float, cells: int = 1) -> Surface:
    """A rectangle in z = 0 that faces +Z, in ``cells`` x ``cells`` squares."""
    step = np.linspace(-0.5, 0.5, cells + 1)
    x, y = np.meshgrid(step * width, step * height, indexing="ij")
    positions = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    beside, above = corner + cells + 1, corner + 1
    return surface(
        positions,
        np.concatenate([np.stack([corner, beside, beside + 1], 1), np.stack([corner, beside + 1, above], 1)]),
    )


def cuboid(x: float, y: float, z: float) -> Surface:
    """A closed block of twelve faces about the origin, its faces looking outwards."""
    positions = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)]) * (x, y, z)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return surface(positions, np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]))


def sphere(radius: float, rings: int = 24) -> Surface:
    """A closed sphere of ``rings`` x ``2 rings`` quads about the origin, its faces looking outwards."""
    around = 2 * rings
    polar = np.linspace(0, np.pi, rings + 1)[1:-1]
    turn = np.arange(around) * 2 * np.pi / around
    ring = np.stack(
        [
            np.outer(np.sin(polar), np.sin(turn)),
            np.repeat(np.cos(polar)[:, None], around, axis=1),
            np.outer(np.sin(polar), np.cos(turn)),
        ],
        axis=2,
    ).reshape(-1, 3)
    positions = np.concatenate([ring, [[0, 1, 0], [0, -1, 0]]]) * radius
    top, bottom = len(ring), len(ring) + 1
    here = np.arange(around)
    beside = (here + 1) % around
    caps = [np.stack([np.full(around, top), here, beside], 1)]
    last = (rings - 2) * around
    caps.append(np.stack([np.full(around, bottom), last + beside, last + here], 1))
    for row in range(rings - 2):
        upper, lower = row * around, (row + 1) * around
        caps.append(np.stack([upper + here, lower + here, lower + beside], 1))
        caps.append(np.stack([upper + here, lower + beside, upper + beside], 1))
    return surface(positions, np.concatenate(caps))


def box(
    center: tuple[float, float, float] = (0, 0, 0),
    size: tuple[float, float, float] = (4, 1, 0.5),
    axes: Float = IDENTITY,
) -> Boxes:
    """One box; its letters read along +X and face +Z unless turned."""
    return Boxes(np.array([center], dtype=np.float64), axes[None].copy(), np.array([size], dtype=np.float64))


def boxes(*several: Boxes) -> Boxes:
    return Boxes(
        np.concatenate([one.center for one in several]),
        np.concatenate([one.axes for one in several]),
        np.concatenate([one.size for one in several]),
    )


def rotation(axis: tuple[float, float, float], degrees: float) -> Float:
    """Rotation matrix about ``axis`` (Rodrigues)."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew)


def layouts(aspect: float, *, lines: int = 1) -> Layouts:
    """A text that is so many times as high as wide in one line, in 1 to a number of ``lines``."""
    return Layouts(tuple(text(count * aspect, count) for count in range(1, lines + 1)))


def text(aspect: float, lines: int = 1) -> Artwork:
    """What placement knows of lines of text so many times as high as each is wide."""
    return Artwork("watermark", (), (1.3 * lines - 0.3) * aspect, 0.41, aspect)
