"""The formats of files, and a file that was written in one of them."""

from dataclasses import dataclass, field
from enum import StrEnum


class Format(StrEnum):
    """The formats, and an archive with a model of each: :mod:`core.formats.registry` has their rows."""

    GLB = "glb"
    GLTF = "gltf"
    OBJ = "obj"
    STL = "stl"
    PLY = "ply"
    OFF = "off"
    THREEMF = "3mf"
    DAE = "dae"
    GLB_ZIP = "glb+zip"
    GLTF_ZIP = "gltf+zip"
    OBJ_ZIP = "obj+zip"
    STL_ZIP = "stl+zip"
    PLY_ZIP = "ply+zip"
    OFF_ZIP = "off+zip"
    THREEMF_ZIP = "3mf+zip"
    DAE_ZIP = "dae+zip"

    @property
    def inner(self) -> "Format":
        """The format of the model itself, out of its archive."""
        return Format(self.removesuffix("+zip"))

    @property
    def archived(self) -> "Format":
        """An archive with a model of this format."""
        return Format(f"{self.inner}+zip")

    @property
    def ending(self) -> str:
        """The ending of the model's name."""
        return f".{self.inner}"


@dataclass(frozen=True, eq=False)
class OutputFile:
    """A written model.

    Attributes:
        format: of the file.
        data: its bytes.
    """

    format: Format
    data: bytes


@dataclass(frozen=True, eq=False)
class Written:
    """A model in another format than GLB.

    Attributes:
        files: by name, the model first.
        unit: of its coordinates; None where the input has none that is known, and its numbers were kept.
        up: the axis that points up, likewise.
        left_out: contents of the GLB that it does not have, in words.
    """

    files: dict[str, bytes]
    unit: str | None
    up: str | None
    left_out: list[str] = field(default_factory=list)
