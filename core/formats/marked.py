"""Inputs of the writers of exports, and the coordinates that these are in."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from core.arrays import Float
from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.draw import draw
from core.formats.drawing import Drawing
from core.formats.format import Format
from core.formats.source import Source
from core.formats.vertices import restored
from core.gltf.edit import SurfaceEdit
from core.gltf.scene import Scene

UNITLESS = (Format.OBJ, Format.STL, Format.PLY, Format.OFF)
PRINTED = (Format.STL, Format.THREEMF)  # what slicers read

_PRINTERS = np.array([[1000.0, 0, 0, 0], [0, 0, -1000, 0], [0, 1000, 0, 0], [0, 0, 0, 1]])


@dataclass(frozen=True, eq=False)
class Marked:
    """A watermarked model, and what it was made from.

    Attributes:
        scene: of the result.
        before: of the input.
        edit: the change between both; None where there is none, or where it is not known.
        format: of the input.
        source: the input.
        budgets: that it was read within.
        label: statements of the machine-readable label by their full names; empty where none was asked for.
    """

    scene: Scene
    before: Scene
    edit: SurfaceEdit | None
    format: Format
    source: Source
    budgets: Budgets
    label: Mapping[str, str]

    @property
    def label_lines(self) -> list[str]:
        """The label for the comments of a text."""
        return [f"{name.rpartition('/')[2]}: {' '.join(text.split())}" for name, text in self.label.items()]

    @property
    def had_colors(self) -> bool:
        """True where vertices of the input have colours."""
        return any("COLOR_0" in drawn.primitive.attributes for drawn in self.before.primitives)


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The coordinates of an export: the matrix (4, 4) that leads to them from the scene, their unit and upward axis."""

    matrix: Float
    unit: str | None
    up: str | None


def coordinates(source: Format, target: Format) -> Coordinates:
    """The coordinates in which an asset that came in one format is written in another.

    Where the input says no unit, numbers and axes stay as they are. Else they are those of glTF, metres with Y up,
    and for printing millimetres with Z up.
    """
    if source.inner in UNITLESS:
        return Coordinates(np.eye(4), None, None)
    if target in PRINTED:
        return Coordinates(_PRINTERS, "millimeter", "z")
    return Coordinates(np.eye(4), "meter", "y")


def drawn(marked: Marked, target: Format, *, vertex_colors: bool = False) -> tuple[Drawing, Coordinates]:
    """The drawing of a result with all parts in the coordinates of an export.

    Raises:
        MeshmarkError: ``unsupported_feature`` where they do not fit 32-bit floats; as :func:`core.formats.draw.draw`.
    """
    frame = coordinates(marked.format, target)
    with np.errstate(over="ignore", invalid="ignore"):
        drawing = draw(marked.scene, vertex_colors=vertex_colors).moved(frame.matrix).in_scene()
    if not all((np.abs(part.positions[part.faces]) <= np.finfo(np.float32).max).all() for part in drawing.parts):
        raise MeshmarkError(
            ErrorCode.UNSUPPORTED_FEATURE,
            f"The asset is too large for {target.upper()}: its coordinates do not fit 32-bit numbers.",
            "Scale it down, or leave `format` out.",
        )
    return drawing, frame


def drawn_again(marked: Marked, original: Float, *, vertex_colors: bool) -> Drawing:
    """The drawing of a result with the very coordinates (N, 3) of its input, which is of the same format and has one
    mesh."""
    drawing = draw(marked.scene, vertex_colors=vertex_colors)
    parts = [
        replace(part, matrix=np.eye(4), positions=restored(part.positions, original, part.matrix[:3, 3]))
        for part in drawing.parts
    ]
    return replace(drawing, parts=parts)
