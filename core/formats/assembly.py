"""Bodies with their materials, and their instances: the result of the readers of all formats but glTF."""

from dataclasses import dataclass, field

import numpy as np

from core.arrays import Float
from core.errors import ErrorCode
from core.formats.polygons import PolygonMesh
from core.notices import Notice


@dataclass(frozen=True, eq=False)
class Instance:
    """A node that draws a body.

    Attributes:
        name: of the node.
        body: number in :attr:`Assembly.bodies`.
        matrix: (4, 4) float64 from the body to the assembly, for column vectors.
    """

    name: str
    body: int
    matrix: Float = field(default_factory=lambda: np.eye(4))


@dataclass(frozen=True, eq=False)
class Assembly:
    """Bodies in the coordinates and units of the file.

    Attributes:
        bodies: the meshes, by number.
        names: their names.
        instances: the drawn ones, in file order.
        frame: (4, 4) from the assembly to metres with Y up, where the format defines unit and axes.
        warnings: content of the file that could not be carried.
    """

    bodies: list[PolygonMesh]
    names: list[str]
    instances: list[Instance]
    frame: Float = field(default_factory=lambda: np.eye(4))
    warnings: list[Notice] = field(default_factory=list)


def single(mesh: PolygonMesh, warnings: list[Notice]) -> Assembly:
    """The assembly of a format of a single mesh without names."""
    return Assembly([mesh], ["model"], [Instance("model", 0)], warnings=warnings)


def dropped(sentence: str, remedy: str = "Send the asset as a GLB to keep it.") -> Notice:
    """The warning for a part of the file that the result does not have."""
    return Notice(ErrorCode.UNSUPPORTED_FEATURE, sentence, remedy)
