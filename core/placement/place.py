"""The whole of placement for one text: the widths from the widest on, each for what is served poorly so far."""

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
from core.placement.selection import select

# Heights of the text, in legible ones; the small one is only for what nothing higher shows, the last only where there
# is nothing else at all.
HEIGHTS, SMALL, LAST_RESORT = (3.1, 2.4, 1.85, 1.4, 1.0), 0.6, 0.4
NARROWER = 1.5  # from one to the next width below those, which text in one line has to be on small assets if it is long
# A direction is served well by as large a share of what text of a width can do for it at best. With so many of the
# directions that any surface looks at served well, text of that width is not tried.
BETTER, ENOUGH = 0.85, 0.98


def ladder(aspect: float) -> list[float]:
    """The widths, from the widest on, at which text of this height over its width is tried."""
    widths = [text_width(height, aspect) for height in (*HEIGHTS, SMALL, LAST_RESORT)]
    narrowest = LAST_RESORT * legible_height() / float(np.sqrt(aspect * USUAL_ASPECT))  # as much area as a word's
    while widths[-1] > NARROWER * narrowest:
        widths.append(widths[-1] / NARROWER)
    return sorted(set(widths), reverse=True)


def _widths(context: PlacementContext) -> list[float]:
    """The widths for what is asked, from the widest on.

    Raises:
        MeshmarkError: ``no_placement`` where there is less surface than any text covers.
    """
    asked = context.parameters.size
    widths = [asked] if asked is not None else ladder(context.lettering.aspect)
    # Letters stand on as much surface as they cover. Less than that is no asset but needles, on which searches for
    # the closest point take forever.
    area = float(context.ground.areas.sum())
    widths = [width for width in widths if width**2 * context.lettering.aspect <= area]
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
    close up, each only for the directions that higher text serves worse than it could. It ends where there are none,
    and where all marks that were asked for have their places and the last height changed none of them. Lower text is
    tried where nothing was found. Then the best choice grows, each mark to what its place has room for.

    Args:
        context: where.
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
    standing: Sequence[int],
    rejected: Collection[int],
    rng: np.random.Generator,
) -> Placement:
    """``found`` and more boxes, which keep the numbers they have: places for the directions in which nothing is seen
    of the boxes ``standing`` and of what else could be chosen now that those in ``rejected`` were refused."""
    more, _ = _search(context, _widths(context), found, standing, rejected, rng, lambda _: None)
    return more or found


def _search(
    context: PlacementContext,
    widths: list[float],
    found: Placement | None,
    standing: Sequence[int],
    rejected: Collection[int],
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> tuple[Placement | None, list[dict[str, int]]]:
    """What is found with one width after the other until enough is seen, and what was left of each by stage."""
    parameters, possible = context.parameters, context.facing >= FACING_VIEW
    assert parameters.count is not None
    worth = context.targets.weight[: len(possible)]
    left: list[dict[str, int]] = []
    for step, width in enumerate(widths):
        wanted = None
        if found is not None:
            chosen = select(found, parameters.count, fixed=standing, rejected=rejected, start=found.start)
            if step and len(chosen) == parameters.count and set(chosen) == set(found.start):
                break  # there are as many marks as were asked for, and narrower text would replace none of them
            found = replace(found, start=tuple(chosen))
            if len(chosen) and not found.last_resort[chosen].any():
                poorly = possible & _poorly_covered(context, found, chosen, width)
                if worth[poorly].sum() <= (1 - ENOUGH) * worth[possible].sum():
                    break
                wanted = context.targets.directions[poorly]
            if len(found.boxes) and width < text_width(SMALL, context.lettering.aspect):
                break

        def share(done: float, step: int = step) -> None:
            progress((step + done) / len(widths))

        placement, counts = fit(context, width, wanted, rng, share)
        left.append(counts)
        found = placement if found is None else _merge(found, placement)
        share(1.0)
    if found is None:
        return None, left
    best = select(found, parameters.count, fixed=standing, rejected=rejected, start=found.start)
    found = _widened(context, widths, found, [one for one in best if one not in standing])
    best = select(found, parameters.count, fixed=standing, rejected=rejected, start=best)
    return replace(found, start=tuple(best)), left


def _widened(context: PlacementContext, widths: list[float], found: Placement, which: list[int]) -> Placement:
    """``found`` and wider text at the places of ``which`` of its boxes: as wide as each has room for, short of the next
    of the ``widths``, which was tried there before."""
    ladder, boxes = np.sort(widths), found.boxes[np.array(which, dtype=np.int64)]
    wider = np.searchsorted(ladder, boxes.size[:, 0], side="right")
    return _merge(found, widen(context, boxes, np.append(ladder, 0.0)[wider]))


def _poorly_covered(context: PlacementContext, found: Placement, chosen: list[int], width: float) -> Bool:
    """(D,) directions in which nothing of the ``chosen`` boxes is seen, or what is seen reads clearly worse than text
    of this ``width`` could."""
    served, _ = found.coverage(chosen)
    enough = BETTER * best_possible_coverage(
        width * context.lettering.aspect, context.facing, context.parameters.color, context.objective
    )
    # On the views' pictures text is also worth less for being rolled, which other text would be as well.
    views = len(context.targets.up)
    enough[:views] = np.minimum(enough[:views], context.objective.seen)
    return np.asarray(served[: len(enough)] < enough)


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
        redundancy=one.redundancy,
        proximity_weight=one.proximity_weight,
        start=one.start,
    )


# Why boxes are dropped at each stage, and what helps.
SMALLER = "Ask for a `size` below {narrowest:.3g}, or use a shorter text."
REASONS = {
    "aligned": ("the surface bends away from it or ends under it", SMALLER),
    "free": ("it reaches into a `keep_out` region", "Keep less of the asset out, or use a shorter text."),
    "covered": ("it hangs over an edge, a hole or a second layer", SMALLER),
    "whole": ("a letter would cross a sharp edge, a crack or a fold", SMALLER),
    "opaque": ("it lies over holes or glass", SMALLER),
    "smooth": ("the surface under it is too rough", SMALLER),
    "open": ("another part is right in front of it", SMALLER),
    "thick": (
        "the wall under it is so thin that sunken letters would come through its back",
        'Ask for raised letters (`mode` "emboss"), or for a smaller `relief`.',
    ),
    "seen": (
        "it faces inwards and is seen from no direction",
        "Turn the faces outwards (recalculate the normals), or use a smaller `size`.",
    ),
}


def _no_placement(widths: list[float], left: list[dict[str, int]]) -> MeshmarkError:
    removed = dict.fromkeys(REASONS, 0)
    for counts in left:
        for before, after in pairwise(counts):
            if after in REASONS:
                removed[after] += counts[before] - counts[after]
    # What a thin wall alone keeps from being placed came further than all else.
    worst = "thick" if removed["thick"] else max(removed, key=lambda stage: removed[stage])
    reason, remedy = REASONS[worst]
    tried = sum(counts["candidates"] for counts in left)
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
        f"{'the last' if worst == 'thick' else 'most'} ({removed[worst]}) were dropped because {reason}.",
        remedy.format(narrowest=min(widths)),
    )
