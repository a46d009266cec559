from dataclasses import replace

import numpy as np
import pytest

from core.analysis.facts import SurfaceFacts
from core.analysis.saliency import saliency
from core.parameters import Parameters, Preset
from core.placement.candidates import CandidateOptions
from core.placement.context import build_context
from core.placement.finetune import LevenbergMarquardtOptions
from core.placement.fit import fit
from core.placement.objective import Placement
from core.placement.options import PLACEMENT, PlacementOptions
from tests.core.placement.shapes import carrier, sphere, text

BALL = sphere(10, rings=16)
FACTS = SurfaceFacts(saliency(BALL, 0))


def fitted(options: PlacementOptions | None, preset: Preset = Preset.MERCHANDISE) -> tuple[Placement, dict[str, int]]:
    """The boxes fitted to a ball of radius 10, and the number left after each stage."""
    rng, parameters = np.random.default_rng(0), Parameters(text="watermark", preset=preset).resolved()
    context = build_context(carrier(BALL), FACTS, text(0.125), parameters, rng, options)
    return fit(context, 5.5, None, rng, lambda _: None)


def test_the_papers_preset_has_boxes_half_a_unit_thick_at_places_one_unit_apart() -> None:
    found, left = fitted(None, Preset.PAPER)
    assert found.boxes.size[:, 2] == pytest.approx(0.5)
    assert 100 < left["candidates"] <= 300


def test_a_sweep_over_the_values_of_an_algorithm_needs_only_a_record() -> None:
    few = replace(PLACEMENT, candidates=CandidateOptions(number=70))
    strict = replace(PLACEMENT, levenberg_marquardt=LevenbergMarquardtOptions(bend=0.0))
    left = fitted(None)[1]
    assert fitted(few)[1]["candidates"] < left["candidates"] / 5
    assert fitted(strict)[1]["candidates"] == left["candidates"]
    assert fitted(strict)[1]["aligned"] < left["aligned"]
    assert fitted(PLACEMENT)[1] == left
