"""The whole of placement for one text: candidates, fine-tuning, filters, and what selection needs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from core.asset.surface import MODEL_SIZE, Surface
from core.errors import ErrorCode, MeshmarkError
from core.ground.regions import Regions
from core.ground.saliency import Saliency
from core.ground.texture import Detail
from core.parameters import Mode, Parameters, Preset, Solver
from core.placement.boxes import Boxes
from core.placement.candidates import candidates
from core.placement.filters import (
    above,
    covered,
    footprint,
    occluded,
    roughness_met,
    smooth,
    thin_walled,
    well_aligned,
)
from core.placement.finetune import LOSS_THRESHOLD, adam, distinct, levenberg_marquardt
from core.placement.objective import (
    BARRED,
    FACING_VIEW,
    Columns,
    Placement,
    Terms,
    bend,
    columns,
    cost,
    distance,
    facing,
    likelihood,
    obstructed,
    roll,
)
from core.placement.sampling import sample
from core.placement.selection import select, visibility
from core.placement.surfels import Surfels
from core.spatial import SpatialIndex

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

WIDTHS = (5.5, 4.0, 3.0, 2.0)
SMALL = 1.2  # legible from close up; only for what nothing wider shows
LAST_RESORT = 0.8  # only where there is nothing else at all
# WIDTHS are meant for a word like "watermark", an eighth as high as wide; other proportions get the same area.
USUAL_ASPECT = 0.125
THICKNESS, THINNEST, THICKEST = 0.09, 0.25, 0.6  # of the width; 0.5 at 5.5, as in the paper
PAPER_SAMPLES, PAPER_RADIUS = 300, 1.0
# Drawn before thinning, and about how many stay: as many as one second fits on one core. Narrower text looks only for
# what wider text left unseen, and draws more for it: thin edges and small parts have little of the area.
SAMPLES, CANDIDATES = 8000, 1100
MORE_SAMPLES = 40_000
MORE, FEWEST = 0.6, 0.07  # of CANDIDATES: for each share of all directions that is unseen; at least
# Of that many random darts thinned to a radius r, about 0.5 area / r^2 stay.
PACKING = 0.5
COPY = 0.05  # fitted boxes closer than this are one (finetune.distinct)
LIFT = 1.5  # reliefs above the surface at which visibility starts: just clear of the letters
SKIN = 0.01  # how far below the surface rays start that look for the other side of a wall
SIGHT_GRID = (8, 2)
# With this share of the directions seen that any surface looks at, narrower text is not tried.
ENOUGH = 0.97
LOOKING = 0.001  # share of the surface under which none looks at a direction


def narrowest_legible(aspect: float) -> float:
    """The width under which text of this height over width is legible only from close up, size-30 units."""
    return _scaled(WIDTHS[-1], aspect)


def _scaled(width: float, aspect: float) -> float:
    return min(width * float(np.sqrt(USUAL_ASPECT / aspect)), MODEL_SIZE)


@dataclass(frozen=True, eq=False)
class _Site:
    """What all widths share.

    Attributes:
        surface: the asset.
        ground: the part of it that boxes may stand on.
        normals: (F, 3) of ``surface``, zero where no box may stand.
        surfels: the stand-in for ``ground``.
        index: over ``surface``.
        saliency: of ``surface``.
        detail: of the texture of ``surface``; None where it has one colour.
        regions: what the request keeps out of or prefers.
        aspect: height of the text over its width.
        parameters: resolved.
        served: the columns of the objective.
    """

    surface: Surface
    ground: Surface
    normals: Float
    surfels: Surfels
    index: SpatialIndex
    saliency: Saliency
    detail: Detail | None
    regions: Regions | None
    aspect: float
    parameters: Parameters
    served: Columns


def place(
    surface: Surface,
    index: SpatialIndex,
    saliency: Saliency,
    detail: Detail | None,
    aspect: float,
    parameters: Parameters,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda _: None,
    usable: Bool | None = None,
    regions: Regions | None = None,
) -> Placement:
    """All boxes on ``surface`` that may carry the text; :func:`core.placement.selection.select` picks among them.

    Args:
        surface: the asset.
        index: over ``surface``.
        saliency: of ``surface``.
        detail: of the texture of ``surface``; None where it has one colour.
        aspect: height of the text over its width.
        parameters: resolved. With ``size`` None four widths are tried from the widest on, then one that is legible
            only from close up, each only for the directions in which wider text is not seen, until there are none; a
            last one where nothing was found.
        rng: the source of every draw.
        progress: called with the share done, 0 to 1.
        usable: (F,) the faces that boxes may stand on; all if None. The others still stand in the way.
        regions: what the request keeps out of or prefers; nothing if None.

    Raises:
        MeshmarkError: ``no_placement`` when no box survives, saying what removed most; ``no_faces``.
    """
    assert parameters.count is not None
    if usable is not None and not usable.any():
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"None of the {len(surface.faces)} faces of this asset can carry a watermark: their nodes flatten them, or "
            "their materials are masked, blended or transmit light.",
            "Send an asset with an opaque surface.",
        )
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
    if parameters.size is not None:
        widths = [parameters.size]
    else:
        widths = [_scaled(width, aspect) for width in (*WIDTHS, SMALL, LAST_RESORT)]
    # Letters stand on as much surface as they cover. Less than that is no asset but needles, on which searches for
    # the closest point take forever.
    area = float(ground.areas.sum())
    widths = [width for width in widths if width**2 * aspect <= area]
    if not widths:
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"The surface of this asset has an area of {area:.3g} where its largest side is {MODEL_SIZE:g}: "
            "less than the text would cover.",
            "Check for vertices far away from the others, or use a smaller `size`.",
        )
    served = columns(surface)
    surfels = Surfels(ground, rng)
    site = _Site(surface, ground, normals, surfels, index, saliency, detail, regions, aspect, parameters, served)
    # Nothing on a cube, for one, looks along its diagonals within 45 degrees.
    possible = (site.surfels.normals @ served.directions.T >= FACING_VIEW).mean(axis=0) > LOOKING
    worth = served.weight[: len(possible)]
    found: Placement | None = None
    left: list[dict[str, int]] = []
    wanted: Float | None = None
    for step, width in enumerate(widths):
        if found is not None and len(found.boxes) and width < _scaled(SMALL, aspect):
            break

        def share(done: float, step: int = step) -> None:
            progress((step + done) / len(widths))

        placement, counts = _of_width(site, width, wanted, rng, share)
        left.append(counts)
        found = placement if found is None else _pool(found, placement)
        share(1.0)
        chosen = select(found, parameters.count, start=found.start)
        found = replace(found, start=tuple(chosen))
        if len(found.boxes) and not found.barred[chosen].any():
            unseen = possible & ~found.visible[chosen].any(axis=0)
            if worth[unseen].sum() <= (1 - ENOUGH) * worth[possible].sum():
                break
            wanted = served.directions[unseen]
    assert found is not None
    if len(found.boxes) == 0:
        raise _no_placement(widths, left)
    return found


def _of_width(
    site: _Site,
    width: float,
    wanted: Float | None,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> tuple[Placement, dict[str, int]]:
    """The survivors for one text width, and how many boxes were left after each stage, by stage.

    Only candidates that look towards one of the directions ``wanted`` (K, 3), within 45 degrees, are fitted.
    """
    parameters, index = site.parameters, site.index
    relief = abs(parameters.relief_at(width))
    size = (width, width * site.aspect, float(np.clip(THICKNESS * width, THINNEST, THICKEST)))
    boxes = _candidates(site, size, wanted, rng)
    left = {"candidates": len(boxes)}

    if parameters.solver is Solver.ADAM:
        boxes, loss = adam(boxes, index, progress)
    else:
        boxes, loss = levenberg_marquardt(boxes, index, site.surfels)
    kept = np.flatnonzero(well_aligned(loss))
    boxes, loss = boxes[kept], loss[kept]
    left["aligned"] = len(boxes)
    kept = distinct(boxes, loss, COPY)
    boxes, loss = boxes[kept], loss[kept]
    left["distinct"] = len(boxes)
    if site.regions is not None:
        kept = np.flatnonzero(~site.regions.touches(boxes, margin=relief))
        boxes, loss = boxes[kept], loss[kept]
    left["free"] = len(boxes)

    met = footprint(boxes, index, site.normals, clearance=relief)
    kept = np.flatnonzero(covered(met, boxes))
    boxes, loss = boxes[kept], loss[kept]
    left["covered"] = len(boxes)

    rough = roughness_met(met, site.normals)[kept]
    kept = np.flatnonzero(smooth(rough))
    boxes, loss, rough = boxes[kept], loss[kept], rough[kept]
    left["smooth"] = len(boxes)

    met = footprint(boxes, index, site.normals, relief, SIGHT_GRID, margin=0.0)
    sight = above(boxes, met, LIFT * relief)
    blocked = occluded(boxes, sight, index, reach=width)
    if parameters.mode is Mode.DEBOSS:
        blocked |= thin_walled(boxes, above(boxes, met, -SKIN), index, depth=LIFT * relief)
    visible = np.zeros((len(boxes), len(site.served.directions)), dtype=bool)
    visible[~blocked] = visibility(boxes[~blocked], sight[~blocked], index, site.served.directions)
    left["open"] = int((~blocked).sum())
    bent, preferred = bend(boxes, met.height), np.zeros(len(boxes))
    if site.regions is not None:
        preferred = site.regions.preference(above(boxes, met, 0.0), met.face)
    kept = np.flatnonzero(visible.any(axis=1))
    boxes, loss, rough, visible = boxes[kept], loss[kept], rough[kept], visible[kept]
    bent, preferred = bent[kept], preferred[kept]
    left["seen"] = len(boxes)

    _, salient = site.saliency.under(boxes)
    details, busy = np.zeros(len(boxes)), np.zeros(len(boxes))
    if site.detail is not None:
        _, details, busy = site.detail.under(boxes)
    terms = Terms(
        obstructed=obstructed(visible, facing(boxes, site.served.directions), site.served),
        salient=salient,
        roll=roll(boxes),
        bend=bent,
        rough=rough - 1,
        detail=details,
        busy=busy,
        preferred=preferred,
        distance=distance(boxes, relief, float(site.surface.areas.sum())),
    )
    placement = Placement(
        boxes=boxes,
        loss=loss,
        roughness=rough,
        visible=visible,
        likelihood=likelihood(boxes, visible, bent, site.served),
        cost=cost(terms),
        barred=(salient > BARRED) | (details > BARRED),
        weight=site.served.weight,
    )
    return placement, left


def _candidates(site: _Site, size: tuple[float, float, float], wanted: Float | None, rng: np.random.Generator) -> Boxes:
    """Boxes to start from; where directions are ``wanted``, only on surface that looks there."""
    if site.parameters.preset is Preset.PAPER:
        points, face = sample(site.ground, PAPER_SAMPLES, rng)
        return candidates(points, site.ground.normals[face], size, PAPER_RADIUS)
    number, most = SAMPLES, float(CANDIDATES)
    if wanted is not None:
        number, most = MORE_SAMPLES, CANDIDATES * max(MORE * len(wanted) / len(site.served.directions), FEWEST)
    points, face = sample(site.ground, number, rng)
    normals = site.ground.normals[face]
    area = float(site.ground.areas.sum())
    if wanted is not None:
        looking = np.flatnonzero((normals @ wanted.T >= FACING_VIEW).any(axis=1))
        area *= len(looking) / number
        points, normals = points[looking[:SAMPLES]], normals[looking[:SAMPLES]]
    return candidates(points, normals, size, float(np.sqrt(PACKING * area / most)))


def _pool(one: Placement, other: Placement) -> Placement:
    """The boxes of both; those of ``one`` keep their numbers."""
    return Placement(
        boxes=Boxes(
            np.concatenate([one.boxes.center, other.boxes.center]),
            np.concatenate([one.boxes.axes, other.boxes.axes]),
            np.concatenate([one.boxes.size, other.boxes.size]),
        ),
        loss=np.concatenate([one.loss, other.loss]),
        roughness=np.concatenate([one.roughness, other.roughness]),
        visible=np.concatenate([one.visible, other.visible]),
        likelihood=np.concatenate([one.likelihood, other.likelihood]),
        cost=np.concatenate([one.cost, other.cost]),
        barred=np.concatenate([one.barred, other.barred]),
        weight=one.weight,
        start=one.start,
    )


REASONS = {
    "aligned": f"the surface bends away from it or ends under it (loss above {LOSS_THRESHOLD})",
    "free": "it reaches into a `keep_out` box",
    "covered": "it hangs over an edge, a hole or a second layer",
    "smooth": "the surface under it is too rough",
    "open": "another part is right in front of it or, for sunken letters, right behind it",
    "seen": "it faces inwards and is seen from no direction",
}


def _no_placement(widths: list[float], left: list[dict[str, int]]) -> MeshmarkError:
    removed = dict.fromkeys(REASONS, 0)
    for counts in left:
        for before, after in pairwise(counts):
            if after in REASONS:
                removed[after] += counts[before] - counts[after]
    worst = max(removed, key=lambda stage: removed[stage])
    tried = sum(counts["candidates"] for counts in left)
    sizes = " to ".join(f"{width:.3g}" for width in sorted({widths[0], widths[-1]}, reverse=True))
    return MeshmarkError(
        ErrorCode.NO_PLACEMENT,
        f"No place for the text was found on this asset: {tried} boxes of width {sizes} were tried, and most "
        f"({removed[worst]}) were dropped because {REASONS[worst]}.",
        f"Ask for a `size` below {min(widths):.3g}, or use a shorter text."
        if worst != "seen"
        else "Turn the faces outwards (recalculate the normals), or use a smaller `size`.",
    )
