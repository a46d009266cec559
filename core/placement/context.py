"""The shared inputs of placement, built once per job."""

from dataclasses import dataclass, replace

import numpy as np

from core.analysis.facts import Carrier, SurfaceFacts
from core.arrays import Float
from core.artwork.layouts import Layouts
from core.choices import Preset
from core.errors import ErrorCode, MeshmarkError
from core.geometry.directions import cosines_to_cameras
from core.geometry.products import product
from core.geometry.surface import Surface
from core.geometry.surfels import Surfels
from core.parameters import Parameters
from core.placement.filters import FACING
from core.placement.label_height import picture_side
from core.placement.nearest import Nearest, TangentPlanes
from core.placement.objective import Targets, targets
from core.placement.options import PlacementOptions, labelling, tuned
from core.placement.rims import Rims, rims
from core.placement.watch import UNWATCHED, Watch

FEW = 5000  # samples of the surface that estimate how it looks in a direction
SAME = 1e-6  # difference of the cosines of samples of one plane, at most


@dataclass(frozen=True, eq=False)
class PlacementContext:
    """The asset as every search for places sees it, whatever the width of the text.

    Attributes:
        carrier: the surface, and the faces that boxes may stand on.
        facts: about the surface.
        layouts: of the text.
        parameters: resolved.
        options: the tuned values.
        ground: the faces of the surface that boxes may stand on.
        normals: (F, 3) of the surface, zero where no box may stand.
        nearest: points of the ground.
        rims: the edges that no letter can be cut across; None where there are none.
        targets: of the objective.
        facing: (D,) cosine of the angle at which surface looks at the camera in each direction, at the middle of the
            little that is turned there most. Nothing on a cube, for one, looks along its diagonals.
        watch: somebody who is told of every box.
    """

    carrier: Carrier
    facts: SurfaceFacts
    layouts: Layouts
    parameters: Parameters
    options: PlacementOptions
    ground: Surface
    normals: Float
    nearest: Nearest
    rims: Rims | None
    targets: Targets
    facing: Float
    watch: Watch = UNWATCHED


def build_context(
    carrier: Carrier,
    facts: SurfaceFacts,
    layouts: Layouts,
    parameters: Parameters,
    rng: np.random.Generator,
    options: PlacementOptions | None = None,
    watch: Watch = UNWATCHED,
) -> PlacementContext:
    """The context of one text on an asset.

    Args:
        carrier: the surface, and the faces that boxes may stand on.
        facts: about the surface.
        layouts: of the text.
        parameters: resolved.
        rng: the source of every draw.
        options: the tuned values; those of the preset if None.
        watch: somebody who is told of every box.

    Raises:
        MeshmarkError: ``no_placement`` where no face is cuttable; ``no_faces`` where none has any area.
    """
    surface, cuttable = carrier.surface, carrier.cuttable
    if not cuttable.any():
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"None of the {len(surface.faces)} faces of this asset can carry a watermark: they are hidden or "
            "see-through, or their nodes flatten them.",
            "Send an asset with an opaque surface.",
        )
    # Boxes stand on the ground; a ray that meets any other face meets nothing that looks at it.
    ground, normals = surface, surface.normals
    if not cuttable.all():
        ground = replace(
            surface,
            faces=surface.faces[cuttable],
            face_primitive=surface.face_primitive[cuttable],
            face_triangle=surface.face_triangle[cuttable],
        )
        normals = np.where(cuttable[:, None], normals, 0.0)
    if options is None:
        options = tuned(parameters)
        if parameters.rule is not None and parameters.preset is not Preset.PAPER:
            options = labelling(parameters.rule * picture_side(surface.radius), bool(parameters.palette))
    goal, surfels = targets(surface, options.objective), Surfels(ground, rng)
    return PlacementContext(
        carrier=carrier,
        facts=facts,
        layouts=layouts,
        parameters=parameters,
        options=options,
        ground=ground,
        normals=normals,
        nearest=TangentPlanes(surface, normals, carrier.index, FACING, surfels),
        rims=rims(surface, carrier.component >= 0, layouts, options.rims),
        targets=goal,
        facing=_facing(surfels, goal.directions, options.search.looking),
        watch=watch,
    )


def _facing(surfels: Surfels, directions: Float, least: float) -> Float:
    """(D,) see :class:`PlacementContext`.

    The surface is found by how it would look at a camera far away: on a large side the points that look best at a near
    one are at the rim, where no text can stand.

    Args:
        surfels: of the surface.
        directions: (D, 3) of the cameras.
        least: share of the surface that has to look at each.
    """
    some = slice(None, None, len(surfels.normals) // FEW)
    normals = surfels.normals[some]
    far = product(normals, directions.T)
    ranked = round((1 - least) * len(far))
    best = far >= np.partition(far, ranked, axis=0)[ranked] - SAME
    near = cosines_to_cameras(surfels.centers[some], normals, directions)
    return np.asarray(np.nanmedian(np.where(best, near, np.nan), axis=0))
