"""A scene as exports have it: parts with vertices of their own, and looks that are no glTF any more."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from core.arrays import Float, Int
from core.geometry.products import product
from core.gltf.colors import srgb

Rgba = tuple[float, float, float, float]

WHITE = (1.0, 1.0, 1.0, 1.0)
NEUTRAL = (0.8, 0.8, 0.8, 1.0)  # what formats without materials are read with


@dataclass(frozen=True)
class Look:
    """A material; all colours are linear.

    Attributes:
        name: empty where it has none.
        color: RGBA factor.
        image, normal_map: numbers of images of the drawing.
        metallic, roughness: 0 to 1.
        emissive: RGB.
        masked: the alpha of the image cuts the surface out.
    """

    name: str = ""
    color: Rgba = WHITE
    image: int | None = None
    normal_map: int | None = None
    metallic: float = 0.0
    roughness: float = 0.7
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    masked: bool = False

    @property
    def is_neutral(self) -> bool:
        """True for the look of surface that has neither material nor colour."""
        return not self.name and self.image is None and self.color == NEUTRAL

    @property
    def is_white(self) -> bool:
        """True for a look that leaves vertices the colours that they have."""
        return not self.name and self.image is None and self.color == WHITE


@dataclass(frozen=True, eq=False)
class Part:
    """The triangles that one node, or one instance of it, draws.

    Attributes:
        name: of the node.
        node: its glTF index.
        mesh: equal for parts of equal positions and faces.
        matrix: (4, 4) from its own coordinates to the scene.
        positions: (V, 3) float64 in its own coordinates, or in others where a writer has moved it.
        faces: (T, 3) int64.
        look: (T,) int64 into the looks of the drawing.
        normals: (V, 3) unit vectors, or None; rows of NaN have none.
        uv: (V, 2) with V downwards, or None; rows of NaN have none.
        colors: (V, 4) linear, which multiply the look, or None.
    """

    name: str
    node: int
    mesh: int
    matrix: Float
    positions: Float
    faces: Int
    look: Int
    normals: Float | None
    uv: Float | None
    colors: Float | None

    def moved(self, matrix: Float) -> "Part":
        """The part in the coordinates that ``matrix`` (4, 4) leads to; triangles turn over where it mirrors."""
        if np.array_equal(matrix, np.eye(4)):
            return replace(self, matrix=np.eye(4))
        part, faces = matrix[:3, :3], self.faces
        if mirrored := np.linalg.det(part) < 0:
            faces = faces[:, [0, 2, 1]]
        normals = self.normals
        if normals is not None:  # by the cofactors, which need no inverse
            cofactors = np.stack([np.cross(part[i - 2], part[i - 1]) for i in range(3)])
            normals = _unit(product(normals, -cofactors.T if mirrored else cofactors.T))
        placed = product(self.positions, part.T) + matrix[:3, 3]
        return replace(self, matrix=np.eye(4), positions=placed, faces=faces, normals=normals)


@dataclass(frozen=True, eq=False)
class Drawing:
    """The parts of a scene in order, with their looks and the encoded images of these.

    Attributes:
        parts: those with triangles.
        looks: that parts count.
        images: encoded, as (ending, bytes).
        left_out: contents of the scene that no part has.
    """

    parts: list[Part]
    looks: list[Look]
    images: list[tuple[str, bytes]]
    left_out: list[str] = field(default_factory=list)

    def in_scene(self) -> "Drawing":
        """The drawing with all parts in the coordinates of the scene."""
        return replace(self, parts=[part.moved(part.matrix) for part in self.parts])

    def moved(self, matrix: Float) -> "Drawing":
        """The drawing with ``matrix`` (4, 4) applied to the scene."""
        if np.array_equal(matrix, np.eye(4)):
            return self
        return replace(self, parts=[replace(part, matrix=product(matrix, part.matrix)) for part in self.parts])


def base_colors(drawing: Drawing, part: Part) -> Float:
    """(T, 3, 4) linear colours of the corners of a part's faces, textures left aside."""
    factors = np.array([look.color for look in drawing.looks])[part.look]
    colors = np.repeat(factors[:, None], 3, axis=1)
    return colors if part.colors is None else colors * part.colors[part.faces]


def bytes_of(colors: Float) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """sRGB bytes (..., 4) of linear colours with alpha (..., 4)."""
    return np.rint(srgb(np.clip(colors, 0, 1)) * 255).astype(np.uint8)


def _unit(vectors: Float) -> Float:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.full_like(vectors, np.nan), where=length > 0))
