"""Stages that the boxes of one text width pass, and why each drops some of them."""

from enum import StrEnum


class Stage(StrEnum):
    """Stage of fitting and filtering, in this order; named by what the boxes are that it leaves."""

    CANDIDATES = "candidates"
    """Drawn on the surface, before any fitting."""
    ALIGNED = "aligned"
    """Fitted with a loss below the limit."""
    DISTINCT = "distinct"
    """No copies of each other."""
    FREE = "free"
    """Outside all `keep_out` regions."""
    COVERED = "covered"
    """With one layer of one component of the surface under all of their footprint."""
    WHOLE = "whole"
    """Not crossed by a rim of the surface."""
    OPAQUE = "opaque"
    """On opaque surface only."""
    SMOOTH = "smooth"
    """With a roughness below the threshold, and level with the surface."""
    OPEN = "open"
    """Without another part in front of them."""
    THICK = "thick"
    """On a wall thick enough for letters sunk into it."""
    SEEN = "seen"
    """Visible from at least one direction."""


SMALLER = "{smaller}"
REASONS: dict[Stage, tuple[str, str]] = {
    Stage.ALIGNED: ("the surface bends away from it or ends under it", SMALLER),
    Stage.FREE: ("it reaches into a `keep_out` region", "Keep less of the asset out, or use {plainer}."),
    Stage.COVERED: ("it hangs over an edge, a hole or a second layer", SMALLER),
    Stage.WHOLE: ("a letter would cross a sharp edge, a crack or a fold", SMALLER),
    Stage.OPAQUE: ("it lies over holes or glass", SMALLER),
    Stage.SMOOTH: ("the surface under it is too rough or turned against it", SMALLER),
    Stage.OPEN: ("another part is right in front of it", SMALLER),
    Stage.THICK: (
        "the wall under it is so thin that sunken letters would come through its back",
        'Ask for raised letters (`mode` "emboss"), or for a smaller `relief`.',
    ),
    Stage.SEEN: (
        "it faces inwards and is seen from no direction",
        "Turn the faces outwards (recalculate the normals), or use a smaller `size`.",
    ),
}
"""What to tell of boxes that a stage dropped: why, and what helps; names in braces stand for functions of
:mod:`core.artwork.advice`. Copies are dropped for no fault of the surface."""
