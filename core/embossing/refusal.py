"""Reasons for which a watermark cannot be embossed at a box."""

from enum import StrEnum


class Refusal(StrEnum):
    """Reason for which a box is refused: a value, not an exception, for the next candidate is tried."""

    NOT_WHOLE = "not_whole"
    """A letter would cross the edge of the surface, of a part, or a fold."""
    CUT_FAILED = "cut_failed"
    """Neither the split nor the arrangement gave a triangulation that closes."""
    SECOND_LAYER = "second_layer"
    """Another surface lies within reach of the letters' tops."""
    THIN_WALL = "thin_wall"
    """Sunken letters would come through the back."""
    FOLDED = "folded"
    """The lifted letters would turn over: the surface is too strongly curved for the relief."""
    TOO_FINE = "too_fine"
    """The cut has edges that the file's 32-bit coordinates cannot tell apart."""
    TOO_DENSE = "too_dense"
    """More triangles or parts lie under the text than can be cut in reasonable time."""
    NOT_CLOSED = "not_closed"
    """The new faces do not meet the old ones edge by edge."""
    UNDRAWN = "undrawn"
    """The written file was read back, and a viewer draws too little of the letters, or only their backs."""


CHEAP = (Refusal.NOT_WHOLE,)
"""Refusals that come before any costly work."""

SMALLER = "{smaller}"
EXPLAINED: dict[Refusal, tuple[str, str]] = {
    Refusal.NOT_WHOLE: ("a letter would cross an edge of the surface, of a part, or a fold", SMALLER),
    Refusal.CUT_FAILED: ("the surface there has no clean cut along the letters", SMALLER),
    Refusal.SECOND_LAYER: (
        "another surface lies within reach of the letters",
        "Ask for a smaller `relief` or `size`, for raised letters where they are sunken, or remove doubled surfaces.",
    ),
    Refusal.THIN_WALL: (
        "the wall is so thin that sunken letters would come through its back",
        'Ask for raised letters (`mode` "emboss"), or for a smaller `relief`.',
    ),
    Refusal.FOLDED: (
        "the surface is too strongly curved for letters of this relief",
        "Ask for a smaller `relief` or `size`.",
    ),
    Refusal.TOO_FINE: (
        "the file's 32-bit coordinates are too coarse for letters this far from the origin",
        "Move the model to the origin of its own coordinates.",
    ),
    Refusal.TOO_DENSE: (
        "more triangles or parts lie under the text than can be cut in reasonable time",
        "Ask for a smaller `size`, or reduce the number of triangles.",
    ),
    Refusal.NOT_CLOSED: ("the surface there touches or crosses itself", SMALLER),
    Refusal.UNDRAWN: (
        "no viewer would draw the letters' tops from the side that they are read from",
        "Turn the faces outwards (recalculate the normals), or make the material double-sided.",
    ),
}
"""What to tell of each: why letters cannot stand there, and what helps; ``{smaller}`` stands for the remedy of
:func:`core.artwork.advice.smaller`."""
