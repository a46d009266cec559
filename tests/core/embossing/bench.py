"""A bench to emboss on: one text, one box, and the state of the mesh afterwards."""

import numpy as np

from core.arrays import Int
from core.artwork.outline import text_artwork
from core.embossing.emboss import Mark, emboss
from core.embossing.islands import LetterIslands, letter_islands
from core.embossing.mesh import WorkingMesh
from core.embossing.refusal import Refusal
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.gltf.edit import SurfaceEdit

TEXT = text_artwork("watermark")
LETTERS: LetterIslands = letter_islands(TEXT)


def box_at(
    center: tuple[float, float, float] = (0.0, 0.0, 0.0),
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0),
    right: tuple[float, float, float] = (1.0, 0.0, 0.0),
    width: float = 4.0,
    thickness: float = 0.5,
    aspect: float = TEXT.aspect,
) -> Boxes:
    n, r = np.array(normal), np.array(right)
    axes = np.array([[r, np.cross(n, r), n]])
    return Boxes(np.array([center]), axes, np.array([[width, width * aspect, thickness]]))


class Bench:
    """A surface under embossing."""

    def __init__(self, surface: Surface) -> None:
        self.surface = surface
        self.index = SpatialIndex(surface.positions, surface.faces)
        self.mesh = WorkingMesh(surface, np.ones(len(surface.faces), dtype=bool))

    def emboss(self, box: Boxes, relief: float = 0.2, letters: LetterIslands = LETTERS) -> Mark | Refusal:
        return emboss(self.mesh, box, letters, relief, self.index)

    def faces(self) -> Int:
        """All faces of the result in topological vertices."""
        edit = self.mesh.edit()
        return np.concatenate([self.surface.weld[self.surface.faces[edit.keep]], edit.vertex])

    def edit(self) -> SurfaceEdit:
        return self.mesh.edit()
