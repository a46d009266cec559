"""The artworks that one watermark may be set as, one of which is chosen for each place."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.arrays import Float, Int
from core.artwork.artwork import SOFT_REACH, Artwork, Logo

ALIKE = 0.02  # relative difference of two aspects, up to which the layouts would serve the same places


@dataclass(frozen=True, eq=False)
class Layouts:
    """Layouts of one watermark, no two of like aspect: the aspect of a box says which one it is for.

    Attributes:
        artworks: the first is the one that was asked for, or has the fewest lines.
    """

    artworks: tuple[Artwork, ...]

    @property
    def logo(self) -> Logo | None:
        """The kind of logo that stands in all of them."""
        return self.artworks[0].logo

    def of(self, size: Float) -> Int:
        """(B,) layout for each box of a ``size`` (B, 3), or (B, 2), in any unit."""
        aspect = np.array([artwork.aspect for artwork in self.artworks])
        return np.asarray(np.abs(np.log(size[:, 1:2] / size[:, :1]) - np.log(aspect)).argmin(axis=1))

    def settings(self, size: Float) -> tuple[str, ...]:
        """The text in each of the ways in which boxes of a ``size`` (B, 3) break it into lines."""
        return tuple("\n".join(self.artworks[number].lines) for number in np.unique(self.of(size)))

    def line_height(self, size: Float) -> Float:
        """(B,) height of a line of text in each box of a ``size`` (B, 3), in its unit."""
        share = np.array([artwork.line_height / artwork.aspect for artwork in self.artworks])
        return np.asarray(size[:, 1] * share[self.of(size)])

    def ink(self, size: Float) -> Float:
        """(B,) share of each box of a ``size`` (B, 3) that the artwork in it covers."""
        return np.array([artwork.ink for artwork in self.artworks])[self.of(size)]

    def soft_reach(self, size: Float) -> Float:
        """(B,) how far round the letters in each box of a ``size`` (B, 3) a soft profile changes the ground, in its
        unit."""
        share = np.array([SOFT_REACH * artwork.stroke for artwork in self.artworks])
        return np.asarray(size[:, 0] * share[self.of(size)])


def distinct_layouts(artworks: Sequence[Artwork]) -> Layouts:
    """The ``artworks`` without those that are of like aspect as an earlier one."""
    kept: list[Artwork] = []
    for artwork in artworks:
        if all(abs(np.log(artwork.aspect / other.aspect)) > ALIKE for other in kept):
            kept.append(artwork)
    return Layouts(tuple(kept))
