from dataclasses import replace

import numpy as np

from core.analysis.facts import SurfaceFacts
from core.analysis.saliency import saliency
from core.parameters import Parameters
from core.placement.candidates import CandidateOptions
from core.placement.context import build_context
from core.placement.finetune import LevenbergMarquardtOptions
from core.placement.fit import fit
from core.placement.options import PLACEMENT, PlacementOptions
from core.placement.rejection import Stage
from tests.core.placement.shapes import carrier, layouts, sphere, text

BALL = sphere(10, rings=16)
FACTS = SurfaceFacts(saliency(BALL, 0))


def fitted(options: PlacementOptions | None) -> dict[Stage, int]:
    """The number of boxes on a ball of radius 10 that are left after each stage."""
    rng, parameters = np.random.default_rng(0), Parameters(text="watermark").resolved()
    context = build_context(carrier(BALL), FACTS, layouts(0.125), parameters, rng, options)
    return fit(context, text(0.125), 5.5, None, rng, lambda _: None)[1]


def test_a_sweep_over_the_values_of_an_algorithm_needs_only_a_record() -> None:
    few = replace(PLACEMENT, candidates=CandidateOptions(number=70))
    strict = replace(PLACEMENT, levenberg_marquardt=LevenbergMarquardtOptions(bend=0.0))
    left = fitted(None)
    assert fitted(few)[Stage.CANDIDATES] < left[Stage.CANDIDATES] / 5
    assert fitted(strict)[Stage.CANDIDATES] == left[Stage.CANDIDATES]
    assert fitted(strict)[Stage.ALIGNED] < left[Stage.ALIGNED]
    assert fitted(PLACEMENT) == left
