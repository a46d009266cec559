"""The ground that watermarks are placed on and embossed into."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.asset.edit import SurfaceEdit
from core.asset.flatten import Scene
from core.asset.surface import Surface
from core.device import spatial_index
from core.errors import ErrorCode, MeshmarkError
from core.ground.editable import editable
from core.ground.orientation import reversed_faces
from core.ground.sheets import Sheets, find_sheets
from core.spatial import SpatialIndex

Int = NDArray[np.int64]
Bool = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Ground:
    """An asset's surface, as seen from outside.

    Attributes:
        surface: the scene's, with the faces in ``turned`` wound the other way round, so that all normals look out.
        turned: (F,) faces that the file winds inside out.
        part: (F,) number of the part that each distinct face belongs to: what hangs together through edges of exactly
            two faces. -1 for others.
        sheets: its layers; hidden faces are not distinct.
        solid: (F,) distinct faces to place watermarks on.
        possible: (F,) distinct faces to fall back to: ``solid`` and the see-through ones.
        index: over the distinct faces; it answers with face numbers of ``surface``.
        resolution: the spacing of the file's 32-bit coordinates where it is widest, size-30 units.
    """

    surface: Surface
    turned: Bool
    part: Int
    sheets: Sheets
    solid: Bool
    possible: Bool
    index: SpatialIndex
    resolution: float

    def as_in_file(self, edit: SurfaceEdit) -> SurfaceEdit:
        """An edit of ``surface`` as one of the scene's own: every triangle wound like the face it was cut from."""
        turned = self.turned[edit.source_face]
        order = np.where(turned[:, None], [0, 2, 1], [0, 1, 2])
        rows = np.arange(len(order))[:, None]
        return replace(
            edit,
            vertex=edit.vertex[rows, order],
            position=edit.position[rows, order],
            barycentric=edit.barycentric[rows[:, :, None], order[:, :, None], order[:, None, :]],
            original=edit.original[rows, order],
        )


def survey(scene: Scene) -> Ground:
    """The :class:`Ground` of a scene.

    Raises:
        MeshmarkError: ``no_faces`` when every face is collapsed; ``device_unavailable``.
    """
    surface, mask = scene.surface, editable(scene)
    sheets = find_sheets(surface, mask.shown.astype(np.int64) + mask.possible + mask.solid)
    distinct = sheets.distinct & mask.shown
    if not distinct.any():
        raise MeshmarkError(
            ErrorCode.NO_FACES,
            f"All {len(surface.faces)} faces of this file are collapsed: two of their corners are one point.",
            "Export the model with its surface, not only points, lines or collapsed triangles.",
        )
    index = spatial_index(surface.positions, surface.faces, np.flatnonzero(distinct))
    turned, part = reversed_faces(surface, distinct, index)
    if turned.any():
        surface = replace(surface, faces=np.where(turned[:, None], surface.faces[:, [0, 2, 1]], surface.faces))
    free = distinct & ~sheets.pinned
    return Ground(
        surface,
        turned,
        part,
        replace(sheets, distinct=distinct),
        mask.solid & free,
        mask.possible & free,
        index,
        _resolution(scene),
    )


def _resolution(scene: Scene) -> float:
    """The spacing of float32 at the largest local coordinate of any primitive, as long as it is in the world."""
    surface, widest = scene.surface, 0.0
    for drawn in scene.primitives:
        used = surface.positions[drawn.first_vertex : drawn.first_vertex + int(drawn.triangles.max()) + 1]
        low, high = surface.to_world(np.stack([used.min(axis=0), used.max(axis=0)]))
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        stretch = 1.0
        if len(drawn.matrices) == 1 and drawn.invertible:
            matrix, shift = drawn.matrices[0, :, :3], drawn.matrices[0, :, 3]
            corners = np.linalg.solve(matrix, (corners - shift).T).T
            stretch = float(np.linalg.norm(matrix, axis=0).max())
        widest = max(widest, float(np.spacing(np.float32(np.abs(corners).max()))) * stretch)
    return widest * surface.scale
