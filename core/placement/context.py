"""The asset as every search for places sees it: what is made once and shared by all text widths."""

from dataclasses import dataclass, replace

import numpy as np

from core.analysis.opacity import Opacity
from core.analysis.regions import Regions
from core.analysis.saliency import Saliency
from core.analysis.skinning import SkinDeformation
from core.analysis.texture import TextureSaliency
from core.arrays import Bool, Float, Int
from core.artwork.outline import Lettering
from core.errors import ErrorCode, MeshmarkError
from core.geometry.products import product
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.geometry.surfels import Surfels
from core.parameters import Parameters
from core.placement.objective import OBJECTIVE, Objective, Targets, targets
from core.placement.rims import Rims, rims

LOOKING, FEW = 0.001, 5000  # share of the surface under which it is no place for text; of so many samples


@dataclass(frozen=True, eq=False)
class PlacementContext:
    """Where places are looked for.

    Attributes:
        surface: the asset.
        ground: the part of it that boxes may stand on.
        normals: (F, 3) of ``surface``, zero where no box may stand.
        component: (F,) which part of ``surface`` each face belongs to; text stands on one.
        surfels: the stand-in for ``ground``.
        index: over ``surface``.
        saliency: of ``surface``.
        texture: of the texture of ``surface``; None where it has one colour.
        skin: of ``surface``; None where it has no skin.
        regions: what the request keeps out of or prefers; None where nothing.
        opacity: says where the faces that boxes may stand on are opaque; None where they are everywhere.
        rims: the edges that no letter can be cut across; None where there are none.
        lettering: the text.
        parameters: resolved.
        objective: the weights of the objective's terms.
        targets: the columns of the objective.
        facing: (D,) cosine of the angle at which surface looks at each direction; all but :data:`LOOKING` of it is
            turned further away. Nothing on a cube, for one, looks along its diagonals.
    """

    surface: Surface
    ground: Surface
    normals: Float
    component: Int
    surfels: Surfels
    index: SpatialIndex
    saliency: Saliency
    texture: TextureSaliency | None
    skin: SkinDeformation | None
    regions: Regions | None
    opacity: Opacity | None
    rims: Rims | None
    lettering: Lettering
    parameters: Parameters
    objective: Objective
    targets: Targets
    facing: Float


def build_context(
    surface: Surface,
    index: SpatialIndex,
    saliency: Saliency,
    detail: TextureSaliency | None,
    joints: SkinDeformation | None,
    lettering: Lettering,
    parameters: Parameters,
    rng: np.random.Generator,
    usable: Bool | None = None,
    part: Int | None = None,
    regions: Regions | None = None,
    opacity: Opacity | None = None,
    objective: Objective = OBJECTIVE,
) -> PlacementContext:
    """The context of one text on an asset.

    Args:
        surface: the asset.
        index: over ``surface``.
        saliency: of ``surface``.
        detail: of the texture of ``surface``; None where it has one colour.
        joints: of ``surface``; None where it has no skin.
        lettering: the text.
        parameters: resolved.
        rng: the source of every draw.
        usable: (F,) the faces that boxes may stand on; all if None. The others still stand in the way.
        part: (F,) which part each face belongs to; all to one if None.
        regions: what the request keeps out of or prefers; nothing if None.
        opacity: says where the faces are opaque; None where they are everywhere.
        objective: the weights of its terms.

    Raises:
        MeshmarkError: ``no_placement`` where no face is usable; ``no_faces`` where none has any area.
    """
    if usable is not None and not usable.any():
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"None of the {len(surface.faces)} faces of this asset can carry a watermark: they are hidden or "
            "see-through, or their nodes flatten them.",
            "Send an asset with an opaque surface.",
        )
    part = np.zeros(len(surface.faces), dtype=np.int64) if part is None else part
    # Boxes stand on the ground; a ray that meets any other face meets nothing that looks at it.
    ground, normals = surface, surface.normals
    if usable is not None and not usable.all():
        ground = replace(
            surface,
            faces=surface.faces[usable],
            face_primitive=surface.face_primitive[usable],
            face_triangle=surface.face_triangle[usable],
        )
        normals = np.where(usable[:, None], normals, 0.0)
    served, surfels = targets(surface, objective), Surfels(ground, rng)
    some = surfels.normals[:: len(surfels.normals) // FEW]
    ranked = round((1 - LOOKING) * len(some))
    facing = np.partition(product(served.directions, some.T), ranked, axis=1)[:, ranked]
    return PlacementContext(
        surface,
        ground,
        normals,
        part,
        surfels,
        index,
        saliency,
        detail,
        joints,
        regions,
        opacity,
        rims(surface, part >= 0, lettering),
        lettering,
        parameters,
        objective,
        served,
        facing,
    )
