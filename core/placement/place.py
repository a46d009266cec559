"""Placement of one text: widths from large to small; each searches only directions that are not yet covered well."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from core.arrays import Bool
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.surface import MODEL_SIZE
from core.placement.context import PlacementContext
from core.placement.fit import fit, widen
from core.placement.legibility import USUAL_ASPECT, legible_height, text_width
from core.placement.objective import FACING_VIEW, Placement, best_possible_coverage
from core.placement.options import SEARCH, SearchOptions
from core.placement.rejection import REASONS, Stage
from core.placement.selection import select


def ladder(aspect: float, options: SearchOptions = SEARCH) -> list[float]:
    """Text widths to try, from the widest on, for text of this height over its width; size-30 units."""
    widths = [text_width(height, aspect) for height in (*options.heights, options.small, options.last_resort)]
    # Of as much area as a word of the lowest height.
    narrowest = options.last_resort * legible_height() / float(np.sqrt(aspect * USUAL_ASPECT))
    while widths[-1] > options.narrower * narrowest:
        widths.append(widths[-1] / options.narrower)
    return sorted(set(widths), reverse=True)


def _widths(context: PlacementContext) -> list[float]:
    """Text widths to try for the request, from the widest on.

    Raises:
        MeshmarkError: ``no_placement`` where there is less surface than any text covers.
    """
    asked = context.parameters.size
    widths = [asked] if asked is not None else ladder(context.artwork.aspect, context.options.search)
    # Letters need as much surface as they cover. An asset with less consists of needles, on which searches for the
    # closest point take forever.
    area = float(context.ground.areas.sum())
    widths = [width for width in widths if width**2 * context.artwork.aspect <= area]
    if not widths:
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"The surface of this asset has an area of {area:.3g} where its largest side is {MODEL_SIZE:g}: "
            "less than the text would cover.",
            "Check for vertices far away from the others, or use a smaller `size`.",
        )
    return widths


def place(
    context: PlacementContext, rng: np.random.Generator, progress: Callable[[float], None] = lambda _: None
) -> Placement:
    """All boxes that may carry the text; :func:`core.placement.selection.select` picks among them.

    With no ``size`` asked for, five heights of text are tried from the highest on, then one that is legible only from
    close up, each only for the directions that higher text covers worse than it could. It ends where there are none,
    and where all marks that were asked for have their places and the last height changed none of them. Lower text is
    tried where nothing was found. Then the chosen marks are widened as far as their places have room.

    Args:
        context: the shared inputs.
        rng: the source of every draw.
        progress: called with the share done, 0 to 1.

    Raises:
        MeshmarkError: ``no_placement`` when no box survives, saying what removed most.
    """
    widths = _widths(context)
    found, left = _search(context, widths, None, (), (), rng, progress)
    if found is None or len(found.boxes) == 0:
        raise _no_placement(widths, left)
    return found


def search_again(
    context: PlacementContext,
    found: Placement,
    placed: Sequence[int],
    rejected: Collection[int],
    rng: np.random.Generator,
) -> Placement:
    """``found`` and more boxes behind them, for the directions that neither the boxes ``placed`` cover nor others that
    could be chosen without those ``rejected``."""
    more, _ = _search(context, _widths(context), found, placed, rejected, rng, lambda _: None)
    return more or found


def _search(
    context: PlacementContext,
    widths: list[float],
    found: Placement | None,
    placed: Sequence[int],
    rejected: Collection[int],
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> tuple[Placement | None, list[dict[Stage, int]]]:
    """Search one width after the other until enough is covered; the boxes, and the number left by stage for each
    width."""
    parameters, options, coverable = context.parameters, context.options, context.facing >= FACING_VIEW
    assert parameters.count is not None
    worth = context.targets.weight[: len(coverable)]
    left: list[dict[Stage, int]] = []
    for step, width in enumerate(widths):
        wanted = None
        if found is not None:
            chosen = select(found, parameters.count, placed, rejected, found.start, options.selection)
            if step and len(chosen) == parameters.count and set(chosen) == set(found.start):
                break  # there are as many marks as were asked for, and narrower text would replace none of them
            found = replace(found, start=tuple(chosen))
            if len(chosen) and not found.last_resort[chosen].any():
                poorly = coverable & _poorly_covered(context, found, chosen, width)
                if worth[poorly].sum() <= (1 - options.search.enough) * worth[coverable].sum():
                    break
                wanted = context.targets.directions[poorly]
            if len(found.boxes) and width < text_width(options.search.small, context.artwork.aspect):
                break

        def share(done: float, step: int = step) -> None:
            progress((step + done) / len(widths))

        placement, counts = fit(context, width, wanted, rng, share)
        left.append(counts)
        found = placement if found is None else _merge(found, placement)
        share(1.0)
    if found is None:
        return None, left
    best = select(found, parameters.count, placed, rejected, found.start, options.selection)
    found = _widened(context, widths, found, [one for one in best if one not in placed])
    best = select(found, parameters.count, placed, rejected, best, options.selection)
    return replace(found, start=tuple(best)), left


def _widened(context: PlacementContext, widths: list[float], found: Placement, which: list[int]) -> Placement:
    """``found`` and wider text at ``which`` of its boxes: as wide as each has room for, short of the next of the
    ``widths``, which was tried there before."""
    ladder, boxes = np.sort(widths), found.boxes[np.array(which, dtype=np.int64)]
    wider = np.searchsorted(ladder, boxes.size[:, 0], side="right")
    return _merge(found, widen(context, boxes, np.append(ladder, 0.0)[wider]))


def _poorly_covered(context: PlacementContext, found: Placement, chosen: list[int], width: float) -> Bool:
    """(D,) directions that the ``chosen`` boxes do not cover, or clearly worse than text of this ``width`` could."""
    covered, _ = found.coverage(chosen)
    enough = context.options.search.covered * best_possible_coverage(
        width * context.artwork.aspect, context.facing, context.parameters.color, context.options.objective
    )
    # In the views rolled text counts less, and other text would be rolled as well.
    views = len(context.targets.up)
    enough[:views] = np.minimum(enough[:views], context.options.objective.seen)
    return np.asarray(covered[: len(enough)] < enough)


def _merge(one: Placement, other: Placement) -> Placement:
    """The boxes of both; those of ``one`` keep their numbers."""
    return Placement(
        boxes=Boxes.concat(one.boxes, other.boxes),
        loss=np.concatenate([one.loss, other.loss]),
        roughness=np.concatenate([one.roughness, other.roughness]),
        visible=np.concatenate([one.visible, other.visible]),
        likelihood=np.concatenate([one.likelihood, other.likelihood]),
        cost=np.concatenate([one.cost, other.cost]),
        last_resort=np.concatenate([one.last_resort, other.last_resort]),
        weight=one.weight,
        objective=one.objective,
        start=one.start,
    )


def _no_placement(widths: list[float], left: list[dict[Stage, int]]) -> MeshmarkError:
    removed = dict.fromkeys(REASONS, 0)
    for counts in left:
        for before, after in pairwise(counts):
            if after in REASONS:
                removed[after] += counts[before] - counts[after]
    # Boxes on thin walls passed every filter before that one: raised letters could stand there, if they are seen.
    worst = Stage.THICK if removed[Stage.THICK] else max(removed, key=lambda stage: removed[stage])
    reason, remedy = REASONS[worst]
    tried = sum(counts[Stage.CANDIDATES] for counts in left)
    if tried == 0:
        return MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            "No place for the text was found on this asset: its faces look inwards or lie inside it, and none is seen "
            "from any direction.",
            "Turn the faces outwards (recalculate the normals).",
        )
    sizes = " to ".join(f"{width:.3g}" for width in sorted({widths[0], widths[-1]}, reverse=True))
    return MeshmarkError(
        ErrorCode.NO_PLACEMENT,
        f"No place for the text was found on this asset: {tried} boxes of width {sizes} were tried, and "
        f"{'the last' if worst is Stage.THICK else 'most'} ({removed[worst]}) were dropped because {reason}.",
        remedy.format(narrowest=min(widths)),
    )
