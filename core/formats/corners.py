"""Corners of faces, for formats whose vertices carry normals, texture coordinates and colours."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float, Int
from core.formats.drawing import Drawing, Part, base_colors, bytes_of
from core.geometry.grouping import float_words, group_rows

_PLAIN = np.array([[255, 255, 255, 255], [231, 231, 231, 255]], np.uint8)  # of surface without a colour


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of all faces: their points (T, 3); their normals (3T, 3), texture coordinates (3T, 2) and sRGB colours
    (3T, 4), or None; the texture (T,) of each face, or -1."""

    points: Int
    normals: NDArray[np.float32] | None
    uv: NDArray[np.float32] | None
    colors: NDArray[np.uint8] | None
    texture: Int

    def vertices(self, *, mapped: bool) -> tuple[Int, Int]:
        """Corners of one point and the same values as one vertex; texture coordinates count where it is ``mapped``.

        Returns:
            (V,) the first corner of each vertex, and (T, 3) the vertices of each face.
        """
        points = self.points.reshape(-1)
        words = [points[:, None].astype(np.uint32)]
        words += [float_words(self.normals)] if self.normals is not None else []
        words += [float_words(self.uv)] if self.uv is not None and mapped else []
        words += [self.colors.view("<u4").astype(np.uint32)] if self.colors is not None else []
        _, first, vertex = np.unique(group_rows(np.hstack(words)), return_index=True, return_inverse=True)
        in_order = np.argsort(points[first], kind="stable")
        rank = np.empty(len(first), dtype=np.int64)
        rank[in_order] = np.arange(len(first))
        return first[in_order], rank[vertex].reshape(-1, 3)


def corners_of(drawing: Drawing, *, keep_colors: bool) -> Corners:
    """The corners of all parts of a drawing, one part after another.

    Args:
        drawing: in its coordinates.
        keep_colors: there are colours even if all are the same that surface without one has.
    """
    sizes = [len(part.positions) for part in drawing.parts]
    starts = np.cumsum(sizes) - sizes
    images = np.array([-1 if look.image is None else look.image for look in drawing.looks])
    colors = np.concatenate([bytes_of(base_colors(drawing, part)).reshape(-1, 4) for part in drawing.parts])
    is_plain = (colors == colors[0]).all() and any((colors[0] == plain).all() for plain in _PLAIN)
    uv = _of_corners(drawing.parts, [part.uv for part in drawing.parts], 2)
    if uv is not None:
        uv[:, 1] = 1 - uv[:, 1]
    return Corners(
        points=np.concatenate([part.faces + start for part, start in zip(drawing.parts, starts, strict=True)]),
        normals=_of_corners(drawing.parts, [part.normals for part in drawing.parts], 3),
        uv=uv,
        colors=None if is_plain and not keep_colors else colors,
        texture=np.concatenate([images[part.look] for part in drawing.parts]),
    )


def _of_corners(parts: list[Part], values: list[Float | None], width: int) -> NDArray[np.float32] | None:
    """(3T, n) values at the corners, 0 where there are none."""
    if all(item is None for item in values):
        return None
    found = [
        np.zeros((3 * len(part.faces), width)) if item is None else item[part.faces.reshape(-1)]
        for part, item in zip(parts, values, strict=True)
    ]
    return np.nan_to_num(np.concatenate(found), posinf=0, neginf=0).astype(np.float32)
