"""The choices that parameters offer, by name."""

from enum import StrEnum


class Preset(StrEnum):
    """Starting values for size, relief and count; anything given explicitly wins."""

    MERCHANDISE = "merchandise"
    PROVENANCE = "provenance"
    PAPER = "paper"


class Strength(StrEnum):
    """Size and number of the marks, which go together."""

    DISCREET = "discreet"
    STANDARD = "standard"
    STRONG = "strong"


class Mode(StrEnum):
    """Raised letters or sunken ones."""

    EMBOSS = "emboss"
    DEBOSS = "deboss"


class Profile(StrEnum):
    """How letters rise from the surface."""

    SOFT = "soft"
    FLAT = "flat"


class Align(StrEnum):
    """Where lines that are shorter than the longest stand."""

    LEFT = "left"
    CENTER = "center"
    RIGHT = "right"


class Wrap(StrEnum):
    """Whether a text without line breaks may be set in several lines."""

    AUTO = "auto"
    NONE = "none"


class Direction(StrEnum):
    """How lines run."""

    HORIZONTAL = "horizontal"
    VERTICAL = "vertical"
    AUTO = "auto"


class LogoPosition(StrEnum):
    """Where a logo stands by the text."""

    LEFT = "left"
    ABOVE = "above"


class Evaluate(StrEnum):
    """Which metrics the report carries."""

    FULL = "full"
    GEOMETRY = "geometry"
    NONE = "none"


class UnmarkedCopies(StrEnum):
    """What becomes of other copies of the asset in its file (scenes, levels of detail) that no mark fits into."""

    LEAVE_OUT = "leave_out"
    KEEP = "keep"


class Solver(StrEnum):
    """How candidate boxes are fitted to the surface."""

    LEVENBERG_MARQUARDT = "levenberg-marquardt"
    ADAM = "adam"


class FileFormat(StrEnum):
    """Format of the result beside the GLB; the same is that of the upload."""

    GLB = "glb"
    SAME = "same"
    STL = "stl"
    OBJ = "obj"
    PLY = "ply"
    THREEMF = "3mf"
