"""One text width: candidates, fine-tuning, filters, and coverage and cost of the boxes that pass."""

from collections.abc import Callable

import numpy as np
import torch

from core.arrays import Bool, Float
from core.artwork.artwork import Artwork
from core.choices import Mode, Profile, Solver
from core.geometry.boxes import Boxes
from core.geometry.directions import looks_at_cameras, to_cameras
from core.geometry.sampling import sample
from core.geometry.spatial import Eye
from core.placement.candidates import along_strips, candidates, right_way_up
from core.placement.context import PlacementContext
from core.placement.cost import Terms, cost, curvature_deviation, distance, obstructed, roll
from core.placement.filters import (
    Footprint,
    above,
    edge_proximity,
    folded,
    footprint,
    fully_supported,
    occluded,
    recentre,
    roughness_met,
    smooth,
    support,
    thin_walled,
    tilted,
)
from core.placement.finetune import adam, correct, distinct, levenberg_marquardt, loss_limit
from core.placement.legibility import text_width
from core.placement.objective import FACING_VIEW, Placement, contrast, facing, likelihood
from core.placement.rejection import Stage
from core.placement.selection import visibility
from core.placement.watch import Watch

# Random points thinned to a radius r leave about this times area / r^2.
PACKING = 0.5
SKIN = 0.01  # how far from the surface rays start that must not meet it


class Left:
    """The boxes that are left after each stage, told to who watches.

    Attributes:
        counts: their number after each.
    """

    def __init__(self, watch: Watch) -> None:
        self.counts: dict[Stage, int] = {}
        self._watch = watch

    def __call__(self, stage: Stage, boxes: Boxes, beside: Boxes | None = None) -> None:
        """Note the ``boxes`` that a stage left, and those ``beside`` them that only a later one drops."""
        every = boxes if beside is None else Boxes.concat(boxes, beside)
        self.counts[stage] = len(every)
        self._watch.passed(stage, every)


def fit(
    context: PlacementContext,
    artwork: Artwork,
    width: float,
    wanted: Bool | None,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> tuple[Placement, dict[Stage, int]]:
    """Boxes of one ``width`` (size-30 units) that may carry the text.

    Args:
        context: the shared inputs.
        artwork: one of the layouts.
        width: of it.
        wanted: (D,) only candidates that look towards one of these directions, within 45 degrees, are fitted; None for
            all.
        rng: the source of every draw.
        progress: called with the share done, 0 to 1, by the slow solver.

    Returns:
        The boxes that passed, and the number left after each :class:`Stage`, in order.
    """
    height = width * artwork.aspect
    options = context.options.candidates
    thickness = max(options.thickness * max(width, height), options.thinnest)
    boxes = _candidates(context, artwork, (width, height, thickness), wanted, rng)
    left = Left(context.watch)
    left(Stage.CANDIDATES, boxes)
    if context.parameters.solver is Solver.ADAM:
        boxes, loss = adam(boxes, context.carrier.index, progress, context.options.adam)
        return _survivors(context, boxes, loss, context.options.adam.threshold, left)
    overhanging = [Boxes.empty()]

    def keep_after_coarse(coarse: Boxes) -> Bool:
        supported = _support(context, coarse) >= context.options.filters.min_support
        overhanging.append(coarse[~supported])
        return supported

    def recentre_on_support(fitted: Boxes) -> tuple[Boxes, Bool]:
        recentred, supported = _recentred_on_support(context, fitted)
        overhanging.append(recentred[~supported])
        return recentred, supported

    solver = context.options.levenberg_marquardt
    boxes, loss = levenberg_marquardt(
        boxes,
        context.nearest,
        torch.device(context.carrier.index.device),
        keep_after_coarse,
        recentre_on_support,
        solver,
    )
    return _survivors(context, boxes, loss, loss_limit(boxes.size, solver), left, Boxes.concat(*overhanging))


def refit(context: PlacementContext, boxes: Boxes) -> Placement:
    """Those of the ``boxes``, which are nearly on the surface, that may carry the text where they are."""
    fitted, loss = correct(
        boxes,
        context.nearest,
        torch.device(context.carrier.index.device),
        lambda moved: _recentred_on_support(context, moved),
        options=context.options.levenberg_marquardt,
    )
    limit = loss_limit(fitted.size, context.options.levenberg_marquardt)
    return _survivors(context, fitted, loss, limit, Left(context.watch))[0]


def _relief(context: PlacementContext, boxes: Boxes) -> Float:
    """(B,) height or depth of the letters at each box, size-30 units."""
    heights = context.layouts.line_height(boxes.size).tolist()
    return np.array([abs(context.parameters.relief_at(height)) for height in heights])


def _recentred_on_support(context: PlacementContext, fitted: Boxes) -> tuple[Boxes, Bool]:
    """Overhanging boxes are recentred on their support before they are rejected; this takes only ray casts. The boxes,
    and which of them are fully supported (B,)."""
    index, relief, options = context.carrier.index, _relief(context, fitted), context.options.filters
    supported = fully_supported(_footprint(context, fitted, relief), fitted, context.carrier.component)
    center = fitted.center.copy()
    for step in options.recentre_steps:
        over = np.flatnonzero(~supported)
        moved = Boxes(center[over], fitted.axes[over], fitted.size[over])
        met = footprint(moved, index, context.normals, relief[over], options.recentre_grid, options.recentre_margin)
        moved = recentre(moved, met, context.carrier.component, step)
        center[over] = moved.center
        supported[over] = fully_supported(_footprint(context, moved, relief[over]), moved, context.carrier.component)
    return Boxes(center, fitted.axes, fitted.size), supported


def _footprint(context: PlacementContext, boxes: Boxes, relief: Float) -> Footprint:
    """The surface under each of the ``boxes``, for letters of a ``relief`` (B,)."""
    options = context.options.filters
    return footprint(boxes, context.carrier.index, context.normals, relief, options.footprint, options.margin)


def _survivors(
    context: PlacementContext,
    boxes: Boxes,
    loss: Float,
    limit: Float | float,
    left: "Left",
    overhanging: Boxes | None = None,
) -> tuple[Placement, dict[Stage, int]]:
    """Fitted ``boxes`` (B,) with a ``loss`` (B,) below the ``limit`` (B,) that pass all filters, and the number
    ``left`` after each stage; ``overhanging`` ones were rejected during fitting.

    A stage that drops boxes for a fault has its reason in :data:`core.placement.rejection.REASONS`.
    """
    parameters, index, options = context.parameters, context.carrier.index, context.options.filters
    kept = np.flatnonzero(loss < limit)
    boxes, loss = right_way_up(boxes[kept]), loss[kept]
    beside = Boxes.empty() if overhanging is None else overhanging
    left(Stage.ALIGNED, boxes, beside)
    kept = distinct(boxes, loss, options.copy)
    boxes, loss = boxes[kept], loss[kept]
    left(Stage.DISTINCT, boxes, beside)
    if context.facts.regions is not None:
        around = _relief(context, boxes)
        if parameters.profile is Profile.SOFT:
            around = np.maximum(around, context.layouts.soft_reach(boxes.size))
        kept = np.flatnonzero(~context.facts.regions.touches(boxes, margin=float(around.max(initial=0))))
        boxes, loss = boxes[kept], loss[kept]
    left(Stage.FREE, boxes, beside)

    met = _footprint(context, boxes, _relief(context, boxes))
    kept = np.flatnonzero(fully_supported(met, boxes, context.carrier.component))
    boxes, loss, met = boxes[kept], loss[kept], met[kept]
    left(Stage.COVERED, boxes)

    if context.rims is not None:
        kept = np.flatnonzero(~context.rims.crossed(boxes, index))
        boxes, loss, met = boxes[kept], loss[kept], met[kept]
    left(Stage.WHOLE, boxes)

    if context.carrier.opacity is not None:
        points = above(boxes, met, 0.0).reshape(-1, 3)
        kept = np.flatnonzero(context.carrier.opacity(points, met.face.ravel()).reshape(met.face.shape).all(axis=1))
        boxes, loss, met = boxes[kept], loss[kept], met[kept]
    left(Stage.OPAQUE, boxes)

    rough, fold = roughness_met(met, context.normals, options), folded(met, context.normals, options)
    kept = np.flatnonzero(smooth(rough, options) & ~tilted(boxes, met, context.normals, options))
    boxes, loss, rough, fold = boxes[kept], loss[kept], rough[kept], fold[kept]
    left(Stage.SMOOTH, boxes)

    relief = _relief(context, boxes)
    met = footprint(boxes, index, context.normals, relief, options.sight_grid, margin=0.0)
    sight = above(boxes, met, options.lift * relief)
    blocked = occluded(boxes, sight, index, reach=options.sight * boxes.size[:, 1])
    left(Stage.OPEN, boxes[~blocked])
    if parameters.mode is Mode.DEBOSS:
        blocked |= thin_walled(boxes, met, index, options.lift * relief)
    left(Stage.THICK, boxes[~blocked])
    visible = np.zeros((len(boxes), len(context.targets.directions)), dtype=bool)
    visible[~blocked] = visibility(boxes[~blocked], sight[~blocked], index, context.targets.directions)
    kept = np.flatnonzero(visible.any(axis=1))
    left(Stage.SEEN, boxes[kept])
    ground = (rough[kept], fold[kept])
    return _valued(context, boxes[kept], loss[kept], ground, visible[kept], met[kept], relief[kept]), left.counts


def _candidates(
    context: PlacementContext,
    artwork: Artwork,
    size: tuple[float, float, float],
    wanted: Bool | None,
    rng: np.random.Generator,
) -> Boxes:
    """Boxes of a ``size`` to start from; where directions are ``wanted``, only on surface that looks there."""
    options = context.options.candidates
    if options.radius is not None:
        points, face = sample(context.ground, options.samples, rng)
        return candidates(points, context.ground.normals[face], size, options.radius)
    # Each layout gets its share of the boxes: a place that one fits into mostly serves the others as well.
    most = options.number / len(context.layouts.artworks)
    if wanted is not None:
        most *= max(options.more * float(wanted.mean()), options.fewest)
    directions = context.targets.directions if wanted is None else context.targets.directions[wanted]
    points, normals, looking, drawn = _looking(context, directions, rng)
    shown = _in_sight(context, points, normals, looking, directions, rng)
    points, normals = points[shown], normals[shown]
    if not len(points):
        return Boxes.empty()
    area = float(context.ground.areas.sum()) * len(points) / drawn
    boxes = candidates(points, normals, size, float(np.sqrt(PACKING * area / (options.choice * most))))
    narrow = options.narrow * min(text_width(1.0, artwork.line_height), size[0])
    around = slice(None, None, int(np.ceil(len(points) * 4 * narrow**2 / (area * options.strip_density))))
    return _most_supported(context, along_strips(boxes, points[around], normals[around], narrow, options))


def _looking(context: PlacementContext, directions: Float, rng: np.random.Generator) -> tuple[Float, Float, Bool, int]:
    """Area samples (N, 3) of the ground, and its normals there (N, 3), that look at any of the ``directions`` (K, 3)
    within 45 degrees; at which (N, K); and the number of samples of all of the ground among which they are so many."""
    options, parts, found = context.options.candidates, list[tuple[Float, Float, Bool]](), 0
    while 2 * found < options.samples and len(parts) < options.draws:
        points, face = sample(context.ground, options.samples, rng)
        normals = context.ground.normals[face]
        looking = looks_at_cameras(points, normals, directions, FACING_VIEW)
        some = np.flatnonzero(looking.any(axis=1))
        parts.append((points[some], normals[some], looking[some]))
        found += len(some)
    points, normals, looking = (np.concatenate(part) for part in zip(*parts, strict=True))
    return points, normals, looking, len(parts) * options.samples


def _most_supported(context: PlacementContext, boxes: Boxes) -> Boxes:
    """The best supported of the ``boxes`` before fitting, one in ``choice``."""
    best_first = np.argsort(-_support(context, boxes), kind="stable")
    return boxes[np.sort(best_first[: int(np.ceil(len(boxes) / context.options.candidates.choice))])]


def _support(context: PlacementContext, boxes: Boxes) -> Float:
    """(B,) supported share of each box, on a coarse grid."""
    grid = context.options.candidates.support_grid
    met = footprint(boxes, context.carrier.index, context.normals, _relief(context, boxes), grid, margin=0.0)
    return support(met, boxes, context.carrier.component)


def _in_sight(
    context: PlacementContext, points: Float, normals: Float, looking: Bool, directions: Float, rng: np.random.Generator
) -> Bool:
    """(N,) which ``points`` (N, 3) of the surface, with unit ``normals`` (N, 3), are visible from one of a few of the
    ``directions`` (K, 3) that they are ``looking`` at (N, K)."""
    turns = rng.permutation(len(directions))
    looking = looking[:, turns]
    looking &= looking.cumsum(axis=1, dtype=np.int16) <= context.options.candidates.probes
    point, turn = np.nonzero(looking)
    start = points[point] + SKIN * normals[point]
    _, face = context.carrier.index.first_hit(start, to_cameras(start, directions[turns[turn]]), Eye.FAR)
    seen = np.zeros(len(points), dtype=bool)
    seen[point[face < 0]] = True
    return seen


def _valued(
    context: PlacementContext,
    boxes: Boxes,
    loss: Float,
    ground: tuple[Float, Float],
    visible: Bool,
    met: Footprint,
    relief: Float,
) -> Placement:
    """The ``boxes`` with their coverage and cost; the ``ground`` of each is so rough and so much folded, and ``met`` is
    the surface there."""
    rough, fold = ground
    parameters, objective = context.parameters, context.options.objective
    bent, preferred = curvature_deviation(boxes, met.height), np.zeros(len(boxes))
    if context.facts.regions is not None:
        preferred = context.facts.regions.preference(above(boxes, met, 0.0), met.face)
    under = context.facts.saliency.pairs_in_boxes(boxes)  # all facts are known at the same samples
    _, salient = context.facts.saliency.under(under)
    details, busy, legible = np.zeros(len(boxes)), np.zeros(len(boxes)), np.ones(len(boxes))
    if context.facts.texture is not None:
        _, details, busy = context.facts.texture.under(under)
        legible = contrast(context.facts.texture.color_under(under), busy, parameters.palette, objective)
    face, likely = np.zeros((2, len(boxes))) if context.facts.features is None else context.facts.features.under(under)
    line = context.layouts.line_height(boxes.size)
    height = line * legible
    last_resort = (salient > objective.max_salient) | (details > objective.max_detail)
    terms = Terms(
        obstructed=obstructed(visible, facing(boxes, context.targets.directions), context.targets),
        salient=salient,
        roll=roll(boxes),
        curvature_deviation=bent,
        rough=rough - 1,
        edge_proximity=edge_proximity(
            boxes, line, context.carrier.index, context.normals, relief, context.options.filters
        ),
        folded=fold,
        articulation=np.zeros(len(boxes)) if context.facts.skin is None else context.facts.skin.under(under),
        detail=details,
        busy=busy,
        face=face > objective.max_feature,
        feature=likely > objective.max_feature,
        preferred=preferred,
        last_resort=last_resort,
        distance=distance(boxes, relief, context.layouts.ink(boxes.size), float(context.carrier.surface.areas.sum())),
    )
    context.watch.valued(boxes, terms)
    return Placement(
        boxes=boxes,
        loss=loss,
        roughness=rough,
        visible=visible,
        likelihood=likelihood(boxes, visible, bent, height, context.targets, bool(parameters.palette), objective),
        cost=cost(terms, objective),
        last_resort=last_resort,
        weight=context.targets.weight,
        objective=objective,
    )
