"""Our own product without one of the objective's terms, to measure the effect of each."""

from dataclasses import replace

import numpy as np

from core.lab.baselines.meshmark import meshmark
from core.lab.baselines.strategy import Marked, Prepared, Strategy
from core.parameters import Parameters
from core.placement.objective import OBJECTIVE, Objective
from core.placement.options import tuned

WITHOUT: dict[str, Objective] = {
    "seeing": replace(OBJECTIVE, seen=0.0),
    "legibility": replace(OBJECTIVE, legibility=0.0),
    "backup": replace(OBJECTIVE, redundancy=0.0),
    "crowd": replace(OBJECTIVE, proximity_weight=0.0),
    "joint": replace(OBJECTIVE, articulation=0.0),
    "crops": replace(OBJECTIVE, crops=0.0),
    "obstructed": replace(OBJECTIVE, obstructed=0.0),
    "saliency": replace(OBJECTIVE, salient=0.0, face=0.0, feature=0.0, last_resort=0.0),
    "roll": replace(OBJECTIVE, roll=0.0),
    "flatness": replace(OBJECTIVE, curvature_deviation=0.0, rough=0.0),
    "exposed": replace(OBJECTIVE, edge_proximity=0.0),
    "texture": replace(OBJECTIVE, detail=0.0, busy=0.0, masking=float("inf")),
    "cost-of-marks": replace(OBJECTIVE, mark=0.0, distortion=0.0),
}


def _without(objective: Objective) -> Strategy:
    def strategy(prepared: Prepared, parameters: Parameters, rng: np.random.Generator) -> Marked:
        return meshmark(prepared, parameters, rng, replace(tuned(parameters), objective=objective))

    return strategy


ABLATED: dict[str, Strategy] = {f"meshmark-no-{name}": _without(objective) for name, objective in WITHOUT.items()}
