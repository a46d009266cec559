"""All tuned values of placement: those of its search, and those of the algorithms that it runs, each in its file."""

from dataclasses import dataclass, replace

from core.choices import Preset, Strength
from core.parameters import Parameters
from core.placement.arrange import ARRANGE, ArrangeOptions
from core.placement.candidates import CANDIDATES, PAPER_CANDIDATES, CandidateOptions
from core.placement.filters import FILTERS, FilterOptions
from core.placement.finetune import ADAM, LEVENBERG_MARQUARDT, AdamOptions, LevenbergMarquardtOptions
from core.placement.legibility import COLORED, PIXELS, PLAIN, legible_height
from core.placement.objective import OBJECTIVE, Objective
from core.placement.rims import RIMS, RimOptions
from core.placement.selection import SELECTION, SelectionOptions


@dataclass(frozen=True)
class SearchOptions:
    """Values of the search over widths of :func:`core.placement.place.place`: all ours; the paper has one width.

    Attributes:
        heights: of the text, as multiples of the legible height.
        small: such a multiple, used only for directions that nothing higher covers.
        last_resort: such a multiple, used only where nothing else fits at all.
        rounds: times that the lowest height before that is searched, or that which is asked for, each time for the
            directions still uncovered.
        gain: of the objective by a search, at least, for the same height to be searched again.
        narrower: ratio of widths below those, which long text needs on small assets.
        looking: share of the surface that has to look in a direction for text to be placed there.
        covered: share of the best possible coverage by text of a width, from which on a direction is covered well.
        enough: share of the directions covered well, from which on text of that width is not tried.
    """

    heights: tuple[float, ...] = (3.1, 2.4, 1.85, 1.4, 1.0)
    small: float = 0.6
    last_resort: float = 0.4
    rounds: int = 8
    gain: float = 0.003
    narrower: float = 1.5
    looking: float = 0.001
    covered: float = 0.85
    enough: float = 0.99


SEARCH = SearchOptions()


@dataclass(frozen=True)
class PlacementOptions:
    """Values of :func:`core.placement.place.place` and of the algorithms that it runs."""

    search: SearchOptions = SEARCH
    candidates: CandidateOptions = CANDIDATES
    adam: AdamOptions = ADAM
    levenberg_marquardt: LevenbergMarquardtOptions = LEVENBERG_MARQUARDT
    filters: FilterOptions = FILTERS
    rims: RimOptions = RIMS
    selection: SelectionOptions = SELECTION
    arrange: ArrangeOptions | None = ARRANGE
    objective: Objective = OBJECTIVE


PLACEMENT = PlacementOptions()
PAPER = PlacementOptions(search=SearchOptions(rounds=1), candidates=PAPER_CANDIDATES, arrange=None)


# Larger text is tried first and is worth more, a second mark in a view is worth what the first is, marks may stand
# closer, and the change of the shape is free: letters are 0.043 of the silhouette on six assets, at an SMSE of 0.007;
# with redundancy 0.4, distortion 1 and the usual proximity 0.035 and 0.005; standard has 0.012 and 0.0007.
STRONG = replace(
    PLACEMENT,
    search=replace(SEARCH, heights=(6.9, 5.3, 4.0, *SEARCH.heights)),
    objective=replace(
        OBJECTIVE, prominent=0.8, large=4.0, redundancy=1.0, mark=0.0, distortion=0.0, proximity_weight=0.003
    ),
)
DISCREET = replace(PLACEMENT, search=replace(SEARCH, heights=SEARCH.heights[-2:]))


# Letters of a label whose rule has a height are worth more up to so much more than it: they are seen from aside, too.
SLACK = 1.15


def labelling(height: float, colored: bool) -> PlacementOptions:
    """The values for a label whose letters should be of a ``height``, size-30 units: those of strong marks, with text
    of that height tried first and worth most."""
    readable, _ = COLORED if colored else PLAIN
    aim = SLACK * height
    highest = max(aim / legible_height(), STRONG.search.heights[0])
    objective = replace(STRONG.objective, prominent=0.9, large=max(aim * PIXELS / readable, 1.0), face=12.0, detail=3.0)
    return replace(
        STRONG,
        search=replace(STRONG.search, heights=(highest, *STRONG.search.heights)),
        objective=objective,
    )


def tuned(parameters: Parameters) -> PlacementOptions:
    """The values that a preset and a strength stand for; :func:`labelling` has those of a label with a rule."""
    if parameters.preset is Preset.PAPER:
        return PAPER
    return {Strength.DISCREET: DISCREET, Strength.STANDARD: PLACEMENT, Strength.STRONG: STRONG}[parameters.strength]
