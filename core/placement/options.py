"""All tuned values of placement: one record for each algorithm, in the file of the algorithm."""

from dataclasses import dataclass

from core.parameters import Preset
from core.placement.candidates import CANDIDATES, PAPER_CANDIDATES, CandidateOptions
from core.placement.filters import FILTERS, FilterOptions
from core.placement.finetune import ADAM, LEVENBERG_MARQUARDT, AdamOptions, LevenbergMarquardtOptions
from core.placement.objective import OBJECTIVE, Objective


@dataclass(frozen=True)
class PlacementOptions:
    """Values of :func:`core.placement.place.place`: those of the algorithms that it runs."""

    candidates: CandidateOptions = CANDIDATES
    adam: AdamOptions = ADAM
    levenberg_marquardt: LevenbergMarquardtOptions = LEVENBERG_MARQUARDT
    filters: FilterOptions = FILTERS
    objective: Objective = OBJECTIVE


PLACEMENT = PlacementOptions()
PAPER = PlacementOptions(candidates=PAPER_CANDIDATES)


def of_preset(preset: Preset) -> PlacementOptions:
    """The values that a preset stands for."""
    return PAPER if preset is Preset.PAPER else PLACEMENT
