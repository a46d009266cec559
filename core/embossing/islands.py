"""The letters as manifold3d's cross-sections, one an island, with sample points to find the surface under it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from manifold3d import CrossSection, FillRule

from core.analysis.contrast import OWN, Look
from core.arrays import Bool, Float, Int
from core.artwork.artwork import Artwork
from core.artwork.layouts import Layouts
from core.choices import Profile
from core.embossing.draft import DRAFT, Draft, DraftOptions, draft
from core.embossing.height_field import PROFILE, HeightField, ProfileOptions, height_field
from core.embossing.patch import Patch
from core.embossing.refusal import Refusal
from core.geometry.boxes import Boxes
from core.geometry.products import product
from core.geometry.spatial import Eye, SpatialIndex

Looks = Callable[[Boxes], list[Look]]

CLEARANCE = 0.032  # line heights between an outline and the boundary of its patch, so that outlines never cross one
LOST_AREA = 1e-9  # square text widths: rounding of the clipper, far smaller than a letter's serif
COINCIDENT = 8e-4  # line heights between two layers that coincide; a ray may hit either of them
AGREEMENT = 0.9  # share of an island's sample rays that must hit one patch; a ray along an edge may miss it


@dataclass(frozen=True, eq=False)
class LetterIslands:
    """Letters of one layout in units of the text's width, centred at the origin.

    Attributes:
        islands: one cross-section for each connected shape, holes included.
        samples: for each island (N, 2) points of its outlines.
        finest: the length of the shortest side of any outline.
        line: height of a line over that of all of the text.
        draft: of their caps.
        soft: their height field where their profile is soft.
    """

    islands: tuple[CrossSection, ...]
    samples: tuple[Float, ...]
    finest: float
    line: float
    draft: Draft
    soft: HeightField | None = None

    @property
    def reach(self) -> float:
        """Text widths round the letters in which they change the ground."""
        return 0.0 if self.soft is None else self.soft.reach


def letter_islands(
    artwork: Artwork, profile: Profile = Profile.FLAT, options: DraftOptions = DRAFT, soft: ProfileOptions = PROFILE
) -> LetterIslands:
    """The islands of ``artwork``; ``options`` are those of their draft, and ``soft`` those of a soft profile."""
    islands = tuple(CrossSection(list(artwork.rings), FillRule.Positive).decompose())
    rings = [island.to_polygons() for island in islands]
    finest = min(float(np.linalg.norm(r - np.roll(r, 1, axis=0), axis=1).min()) for ring in rings for r in ring)
    samples, line = tuple(np.concatenate(ring) for ring in rings), artwork.line_height / artwork.aspect
    field = height_field(CrossSection.compose(list(islands)), None, soft) if profile is Profile.SOFT else None
    return LetterIslands(islands, samples, finest, line, draft(islands, options), field)


@dataclass(frozen=True, eq=False)
class Letters:
    """Letters of all layouts of a text.

    Attributes:
        layouts: of the text.
        dark, light: islands of each layout, those for letters lighter than the ground apart.
        looks: of the letters at boxes.
    """

    layouts: Layouts
    dark: tuple[LetterIslands, ...]
    light: tuple[LetterIslands, ...]
    looks: Looks

    def of(self, box: Boxes, look: Look) -> LetterIslands:
        """The letters for the one ``box``, where they have this ``look``."""
        return (self.light if look.lighter else self.dark)[int(self.layouts.of(box.size)[0])]


def letters_of(
    layouts: Layouts, looks: Looks = lambda boxes: [OWN] * len(boxes), profile: Profile = Profile.FLAT
) -> Letters:
    """The letters of all ``layouts``, of the surface's own colour unless ``looks`` say otherwise."""
    dark = tuple(letter_islands(artwork, profile) for artwork in layouts.artworks)
    light = tuple(
        islands if artwork.light is None else letter_islands(replace(artwork, rings=artwork.light), profile)
        for artwork, islands in zip(layouts.artworks, dark, strict=True)
    )
    return Letters(layouts, dark, light, looks)


def assign_to_patches(
    letters: LetterIslands, found: list[Patch], sources: list[Int], box: Boxes, index: SpatialIndex, *, raised: bool
) -> list[CrossSection] | Refusal:
    """Puts every island on the patch that is uppermost under it; raised ones on either of two that coincide.

    Args:
        letters: to be assigned.
        found: the patches in the one ``box``.
        sources: for each patch the surface faces it consists of.
        box: a single box.
        index: of the original surface.
        raised: the letters rise; sunken ones would lie behind the second of two layers.

    Returns:
        For each patch its letters (empty where it has none); or ``not_whole`` if an island does not fit wholly into
        one patch, ``CLEARANCE`` from its edge, and ``second_layer`` where sunken letters would not be seen.
    """
    faces = np.concatenate([np.empty(0, dtype=np.int64), *sources])
    order = np.argsort(faces, kind="stable")
    owner = np.repeat(np.arange(len(sources)), [len(each) for each in sources])[order]
    faces = faces[order]
    silhouettes: dict[int, CrossSection] = {}
    assigned: list[list[CrossSection]] = [[] for _ in found]
    center, axes, size = box.center[0], box.axes[0], box.size[0]
    aspect = size[1] / size[0] * letters.line
    samples = np.concatenate(letters.samples)
    origins = center + size[0] * product(samples, axes[:2]) + size[2] / 2 * axes[2]
    distances, face = index.first_hit(origins, np.broadcast_to(-axes[2], origins.shape), Eye.ORIGIN)
    last = np.searchsorted(faces, face, side="right") - 1  # of several patches with a face, the last one
    voted = np.where(faces[last] == face, owner[last], -1) if len(faces) else np.full(len(face), -1)
    ends = np.cumsum([len(points) for points in letters.samples])[:-1]
    by_island = zip(
        letters.islands, letters.samples, *(np.split(each, ends) for each in (distances, voted)), strict=True
    )
    for island, points, distance, vote in by_island:
        met = distance <= size[2]
        votes = vote[met]
        if not len(votes):
            return Refusal.NOT_WHOLE
        best = int(np.bincount(votes + 1).argmax()) - 1
        if best < 0:
            return Refusal.NOT_WHOLE
        height = size[2] / (2 * size[0]) - distance[met] / size[0]
        agreeing = votes == best
        others = [patch for k, patch in enumerate(found) if k != best]
        if not raised and any(_level(patch, points[met], height, aspect).any() for patch in others):
            return Refusal.SECOND_LAYER
        if raised and not agreeing.all():
            agreeing[~agreeing] = _level(found[best], points[met][~agreeing], height[~agreeing], aspect)
        if agreeing.sum() < AGREEMENT * len(points):
            return Refusal.NOT_WHOLE
        if best not in silhouettes:
            silhouettes[best] = found[best].inset_silhouette(CLEARANCE * aspect)
        if (island - silhouettes[best]).area() > LOST_AREA:
            return Refusal.NOT_WHOLE
        assigned[best].append(island)
    return [CrossSection.compose(islands) for islands in assigned]


def _level(patch: Patch, points: Float, height: Float, aspect: float) -> Bool:
    """(N,) ``points`` at which the patch is as high, in text widths, as the hits of their rays; a line of the
    text is ``aspect`` times as high as the text is wide."""
    return np.asarray(np.abs(patch.height(points) - height) < COINCIDENT * aspect)
