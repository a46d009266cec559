"""Placement of one text: lines from high to low; each height searches only directions that are not yet covered well."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise, zip_longest

import numpy as np

from core.arrays import Bool
from core.artwork.advice import plainer, smaller, subject
from core.artwork.artwork import Artwork
from core.artwork.layouts import Layouts
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.surface import MODEL_SIZE
from core.placement.arrange import ArrangeOptions, moved, wider
from core.placement.context import PlacementContext
from core.placement.fit import fit, refit
from core.placement.legibility import USUAL_ASPECT, legible_height, text_width
from core.placement.objective import FACING_VIEW, Placement, best_possible_coverage
from core.placement.options import SEARCH, SearchOptions
from core.placement.rejection import REASONS, Stage
from core.placement.selection import climb, select

Step = list[tuple[Artwork, float]]  # layouts, and their widths in size-30 units, whose lines are about equally high


def ladder(line_height: float, options: SearchOptions = SEARCH, least: float = 0.0) -> list[float]:
    """Text widths to try, from the widest on and down to the ``least``, size-30 units; the height of a line is
    ``line_height`` times the width."""
    widths = [text_width(height, line_height) for height in (*options.heights, options.small, options.last_resort)]
    # Of as much area as a word of the lowest height.
    narrowest = options.last_resort * legible_height() / float(np.sqrt(line_height * USUAL_ASPECT))
    while widths[-1] > options.narrower * narrowest:
        widths.append(widths[-1] / options.narrower)
    kept = [width for width in widths if width > least]
    return kept if len(kept) == len(widths) else [*kept, least]


def up_to(most: float | None, widths: list[float], options: SearchOptions = SEARCH) -> list[float]:
    """The ``widths`` with ``most`` in the place of wider ones; where it is the widest, some between are tried, too."""
    if most is None:
        return widths
    wider = widths[:1]
    while wider[0] * options.narrower < most:
        wider.insert(0, wider[0] * options.narrower)
    return [most, *(width for width in [*wider[:-1], *widths] if width < most)]


def _steps(context: PlacementContext) -> list[Step]:
    """Layouts and widths to try for the request, those with the highest lines first.

    Raises:
        MeshmarkError: ``no_placement`` where there is less surface than any text covers.
    """
    asked, artworks, search = context.parameters, context.layouts.artworks, context.options.search
    ladders = [
        [asked.size]
        if asked.size is not None and asked.size_exact
        else up_to(asked.size, ladder(artwork.line_height, search, artwork.least_width), search)
        for artwork in artworks
    ]
    # Letters need as much surface as they cover. An asset with less consists of needles, on which searches for the
    # closest point take forever.
    area = float(context.ground.areas.sum())
    steps = [
        [
            (artwork, width)
            for artwork, width, narrower in zip(artworks, widths, following, strict=True)
            # Long text is as wide as an asset at several heights, of which the lowest is its own.
            if width is not None and width != narrower and width**2 * artwork.aspect <= area
        ]
        for widths, following in pairwise([*zip_longest(*ladders), (None,) * len(artworks)])
    ]
    steps = [step for step in steps if step]
    if not steps:
        raise MeshmarkError(
            ErrorCode.NO_PLACEMENT,
            f"The surface of this asset has an area of {area:.3g} where its largest side is {MODEL_SIZE:g}: "
            f"less than the {subject(context.layouts)} would cover.",
            "Check for vertices far away from the others, or use a smaller `size`.",
        )
    lowest = max(number for number, step in enumerate(steps) if number == 0 or not _tiny(step, search))
    return [*steps[:lowest], *[steps[lowest]] * search.rounds, *steps[lowest + 1 :]]


def _tiny(step: Step, options: SearchOptions) -> bool:
    """True of a step that is only for assets that nothing higher fits on."""
    return all(width < text_width(options.small, artwork.line_height) for artwork, width in step)


def place(
    context: PlacementContext, rng: np.random.Generator, progress: Callable[[float], None] = lambda _: None
) -> Placement:
    """All boxes that may carry the text; :func:`core.placement.selection.select` picks among them.

    Unless a ``size`` is asked for exactly, five heights of a line are tried from the highest on, in each layout of the
    text and none wider than it, then one that is legible only from close up, each only for the directions that higher
    text covers worse than it could. It ends where there are none, and where all marks that were asked for have their
    places and the last height changed none of them. Lower text is tried where nothing was found. Then the chosen marks
    are widened as far as their places have room.

    Args:
        context: the shared inputs.
        rng: the source of every draw.
        progress: called with the share done, 0 to 1.

    Raises:
        MeshmarkError: ``no_placement`` when no box survives, saying what removed most.
    """
    steps = _steps(context)
    found, left = _search(context, steps, None, (), (), rng, progress)
    progress(1.0)
    if found is None or len(found.boxes) == 0:
        raise _no_placement(context.layouts, sorted(width for step in steps for _, width in step), left)
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
    more, _ = _search(context, _steps(context), found, placed, rejected, rng, lambda _: None)
    return more or found


def _search(
    context: PlacementContext,
    steps: list[Step],
    found: Placement | None,
    placed: Sequence[int],
    rejected: Collection[int],
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> tuple[Placement | None, list[dict[Stage, int]]]:
    """Search one height after the other until enough is covered; the boxes, and the number left by stage for each
    layout and width."""
    parameters, options, coverable = context.parameters, context.options, context.facing >= FACING_VIEW
    assert parameters.count is not None
    worth = context.targets.weight[: len(coverable)]
    left: list[dict[Stage, int]] = []
    for number, step in enumerate(steps):
        wanted = None
        if found is not None:
            chosen = climb(found, parameters.count, placed, rejected, found.start, options.selection)
            if number and len(found.boxes):
                gained = found.value(chosen) - found.value(found.start)
                if step is steps[number - 1] and gained < options.search.gain:
                    break  # more of this height gains next to nothing
                if len(chosen) == parameters.count and set(chosen) == set(found.start):
                    break  # there are as many marks as were asked for, and lower text would replace none of them
            found = replace(found, start=tuple(chosen))
            well = [one for one in chosen if not found.last_resort[one]]
            if well:
                poorly = coverable & _poorly_covered(
                    context, found, well, max(width * artwork.line_height for artwork, width in step)
                )
                if worth[poorly].sum() <= (1 - options.search.enough) * worth[coverable].sum():
                    break
                wanted = poorly
            if len(found.boxes) and _tiny(step, options.search):
                break
        for layout, (artwork, width) in enumerate(step):

            def share(done: float, before: float = number + layout / len(step), part: int = len(step)) -> None:
                progress((before + done / part) / len(steps))

            placement, counts = fit(context, artwork, width, wanted, rng, share)
            left.append(counts)
            found = placement if found is None else _merge(found, placement)
            share(1.0)
    if found is None:
        return None, left
    best = select(found, parameters.count, placed, rejected, found.start, options.selection)
    if options.arrange is not None:
        for arranged in (partial(_moved, context), partial(_widened, context, steps)):
            which = np.array([one for one in best if one not in placed], dtype=np.int64)
            found = _merge(found, refit(context, arranged(found.boxes[which], options.arrange)))
            best = climb(found, parameters.count, placed, rejected, best, options.selection)
    return replace(found, start=tuple(best)), left


def _moved(context: PlacementContext, boxes: Boxes, options: ArrangeOptions) -> Boxes:
    """Places near those of the ``boxes`` that look better, see :func:`core.placement.arrange.moved`."""
    carrier = context.carrier
    line = context.layouts.line_height(boxes.size)
    return moved(boxes, line, carrier.index, context.normals, carrier.component, options)


def _widened(context: PlacementContext, steps: list[Step], boxes: Boxes, options: ArrangeOptions) -> Boxes:
    """Wider text at the places of ``boxes``, short of the next width of the ``steps`` in its layout, which was tried
    there before."""
    most, layout = np.zeros(len(boxes)), context.layouts.of(boxes.size)
    for number, artwork in enumerate(context.layouts.artworks):
        widths = np.sort([width for step in steps for other, width in step if other is artwork])
        mine = np.flatnonzero(layout == number)
        following = np.searchsorted(widths, boxes.size[mine, 0], side="right")
        most[mine] = np.append(widths, 0.0)[following]
    return wider(boxes, most, context.options.candidates.thinnest, options)


def _poorly_covered(context: PlacementContext, found: Placement, chosen: list[int], height: float) -> Bool:
    """(D,) directions that the ``chosen`` boxes do not cover, or clearly worse than a line of this ``height`` could."""
    covered, _ = found.coverage(chosen)
    enough = context.options.search.covered * best_possible_coverage(
        height, context.facing, bool(context.parameters.palette), context.options.objective
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


def _no_placement(layouts: Layouts, widths: list[float], left: list[dict[Stage, int]]) -> MeshmarkError:
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
            f"No place for the {subject(layouts)} was found on this asset: its faces look inwards or lie inside it, "
            "and none is seen from any direction.",
            "Turn the faces outwards (recalculate the normals).",
        )
    sizes = " to ".join(f"{width:.3g}" for width in sorted({widths[0], widths[-1]}, reverse=True))
    return MeshmarkError(
        ErrorCode.NO_PLACEMENT,
        f"No place for the {subject(layouts)} was found on this asset: {tried} boxes of width {sizes} were tried, and "
        f"{'the last' if worst is Stage.THICK else 'most'} ({removed[worst]}) were dropped because {reason}.",
        remedy.format(smaller=smaller(layouts, min(widths)), plainer=plainer(layouts)),
    )
