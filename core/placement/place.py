"""The whole of placement for one text: candidates, fine-tuning, filters, and what selection needs."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from core.asset.surface import MODEL_SIZE, Surface
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Mode, Parameters, Preset, Solver
from core.placement.boxes import Boxes
from core.placement.candidates import candidates, upright
from core.placement.filters import (
    above,
    covered,
    footprint,
    occluded,
    roughness,
    smooth,
    thin_walled,
    well_aligned,
)
from core.placement.finetune import LOSS_THRESHOLD, adam, distinct, levenberg_marquardt
from core.placement.sampling import sample
from core.placement.selection import Placement, facing, select, visibility
from core.placement.surfels import Surfels
from core.rendering.views import fibonacci_directions, view_directions
from core.spatial import SpatialIndex

Float = NDArray[np.float64]

WIDTHS = (5.5, 4.0, 3.0, 2.0)
LAST_RESORT = (1.2, 0.8)  # hardly legible but close up; only where nothing wider has room anywhere
# WIDTHS are meant for a word like "watermark", an eighth as high as wide; other proportions get the same area.
USUAL_ASPECT = 0.125
THICKNESS, THINNEST, THICKEST = 0.09, 0.25, 0.6  # of the width; 0.5 at 5.5, as in the paper
PAPER_SAMPLES, PAPER_RADIUS = 300, 1.0
# Drawn before thinning, and about how many stay: as many as one second fits on one core.
SAMPLES, CANDIDATES = 8000, 1100
# Of that many random darts thinned to a radius r, about 0.5 area / r^2 stay.
PACKING = 0.5
COPY = 0.05  # fitted boxes closer than this are one (finetune.distinct)
ROUGHNESS_DENSITY = 60  # area samples under one box
LIFT = 1.5  # reliefs above the surface at which visibility starts: just clear of the letters
SKIN = 0.01  # how far below the surface rays start that look for the other side of a wall
SIGHT_GRID = (8, 2)
FIBONACCI = 200
# What narrower text costs, by the share of the widest that is missing: it only fills what wider text leaves.
NARROW = 0.3
# With this share of all directions seen, narrower text is not tried.
ENOUGH = 0.97


def place(
    surface: Surface,
    index: SpatialIndex,
    aspect: float,
    parameters: Parameters,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda _: None,
    usable: NDArray[np.bool_] | None = None,
) -> Placement:
    """All boxes on ``surface`` that may carry the text; :func:`core.placement.selection.select` picks among them.

    Args:
        surface: the asset.
        index: over ``surface``.
        aspect: height of the text over its width.
        parameters: resolved. With ``size`` None the widest of four widths that covers the asset is taken, and
            where none does, what survived of all of them; two narrower ones are a last resort.
        rng: the source of every draw.
        progress: called with the share done, 0 to 1.
        usable: (F,) the faces that boxes may stand on; all if None. The others still stand in the way.

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
        widths = [min(width * float(np.sqrt(USUAL_ASPECT / aspect)), MODEL_SIZE) for width in WIDTHS + LAST_RESORT]
    usual = widths[: len(WIDTHS)][-1]
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
    surfels = Surfels(ground, rng)
    placements: list[Placement] = []
    left: list[dict[str, int]] = []
    wanted = _directions()[0]
    for step, width in enumerate(widths):

        def share(done: float, step: int = step) -> None:
            progress((step + done) / len(widths))

        placement, counts = place_width(ground, surfels, normals, index, width, aspect, parameters, rng, wanted, share)
        placements.append(placement)
        left.append(counts)
        share(1.0)
        pooled = _pool(placements, widths)
        chosen = select(pooled, parameters.count)
        seen = pooled.visible[chosen].any(axis=0)
        if len(chosen) == parameters.count or pooled.weight[seen].sum() >= ENOUGH:
            break
        if width <= usual and chosen:
            break
        wanted = pooled.directions[~seen]
    if len(pooled.boxes) == 0:
        raise _no_placement(widths, left)
    return pooled


def place_width(
    ground: Surface,
    surfels: Surfels,
    normals: Float,
    index: SpatialIndex,
    width: float,
    aspect: float,
    parameters: Parameters,
    rng: np.random.Generator,
    wanted: Float,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Placement, dict[str, int]]:
    """The survivors for one text width, and how many boxes were left after each stage, by stage.

    Boxes stand on ``ground``, of which ``surfels`` are the stand-in; ``normals`` (F, 3) are those of the faces in
    ``index``, zero where no box may stand. Only candidates that look towards one of the directions ``wanted`` (K, 3),
    within 45 degrees, are fitted.
    """
    relief = abs(parameters.relief_at(width))
    size = (width, width * aspect, float(np.clip(THICKNESS * width, THINNEST, THICKEST)))
    if parameters.preset is Preset.PAPER:
        number, radius = PAPER_SAMPLES, PAPER_RADIUS
    else:
        number, radius = SAMPLES, float(np.sqrt(PACKING * ground.areas.sum() / CANDIDATES))
    boxes = candidates(ground, size, number, radius, rng)
    left = {"candidates": len(boxes)}
    boxes = boxes[np.flatnonzero(facing(boxes, wanted).any(axis=1))]
    left["wanted"] = len(boxes)

    if parameters.solver is Solver.ADAM:
        boxes, loss = adam(boxes, index, progress)
    else:
        boxes, loss = levenberg_marquardt(boxes, index, surfels)
    kept = np.flatnonzero(well_aligned(loss))
    boxes, loss = boxes[kept], loss[kept]
    left["aligned"] = len(boxes)
    kept = distinct(boxes, loss, COPY)
    boxes, loss = boxes[kept], loss[kept]
    left["distinct"] = len(boxes)

    met = footprint(boxes, index, normals, clearance=relief)
    kept = np.flatnonzero(covered(met, boxes))
    boxes, loss = boxes[kept], loss[kept]
    left["covered"] = len(boxes)

    points, face = sample(ground, _roughness_samples(ground, size), rng)
    rough = roughness(boxes, points, ground.normals[face])
    kept = np.flatnonzero(smooth(rough))
    boxes, loss, rough = boxes[kept], loss[kept], rough[kept]
    left["smooth"] = len(boxes)

    met = footprint(boxes, index, normals, relief, SIGHT_GRID, margin=0.0)
    sight = above(boxes, met, LIFT * relief)
    blocked = occluded(boxes, sight, index, reach=width)
    if parameters.mode is Mode.DEBOSS:
        blocked |= thin_walled(boxes, above(boxes, met, -SKIN), index, depth=LIFT * relief)
    kept = np.flatnonzero(~blocked)
    boxes, loss, rough, sight, height = boxes[kept], loss[kept], rough[kept], sight[kept], met.height[kept]
    left["open"] = len(boxes)

    directions, weight = _directions()
    visible = visibility(boxes, sight, index, directions)
    kept = np.flatnonzero(visible.any(axis=1))
    boxes, loss, rough, height, visible = boxes[kept], loss[kept], rough[kept], height[kept], visible[kept]
    left["seen"] = len(boxes)
    cost = _cost(boxes, rough, height)
    return Placement(boxes, loss, rough, cost, visible, directions, weight), left


def _roughness_samples(surface: Surface, size: tuple[float, float, float]) -> int:
    return int(np.clip(ROUGHNESS_DENSITY * surface.areas.sum() / (size[0] * size[1]), 1000, 200_000))


def _directions() -> tuple[Float, Float]:
    """The 24 views and 200 even directions, (D, 3), and their weights (D,): each set is worth half."""
    views, even = view_directions()[0], fibonacci_directions(FIBONACCI)
    weight = np.concatenate([np.full(len(views), 0.5 / len(views)), np.full(len(even), 0.5 / len(even))])
    return np.concatenate([views, even]), weight


def _cost(boxes: Boxes, rough: Float, height: Float) -> Float:
    """(B,) what makes a box a worse place for text: rolled, on bent or on rough ground."""
    level = np.einsum("bi,bi->b", boxes.axes[:, 1], upright(boxes.axes[:, 2])[:, 1])
    roll = np.sqrt(1 - np.clip(level, 0, 1) ** 2)
    bend = np.sqrt((height**2).mean(axis=1)) / (boxes.size[:, 2] / 2)
    return np.asarray(0.6 * roll + bend + (rough - 1))


def _pool(found: list[Placement], widths: Sequence[float]) -> Placement:
    """One placement from several widths, widest first."""
    narrow = np.concatenate(
        [np.full(len(p.boxes), NARROW * (1 - w / widths[0])) for p, w in zip(found, widths, strict=False)]
    )
    return Placement(
        boxes=Boxes(
            np.concatenate([p.boxes.center for p in found]),
            np.concatenate([p.boxes.axes for p in found]),
            np.concatenate([p.boxes.size for p in found]),
        ),
        loss=np.concatenate([p.loss for p in found]),
        roughness=np.concatenate([p.roughness for p in found]),
        cost=np.concatenate([p.cost for p in found]) + narrow,
        visible=np.concatenate([p.visible for p in found]),
        directions=found[0].directions,
        weight=found[0].weight,
    )


REASONS = {
    "aligned": f"the surface bends away from it or ends under it (loss above {LOSS_THRESHOLD})",
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
