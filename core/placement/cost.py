"""Costs of a mark by itself: the terms of the objective that are subtracted (:mod:`core.placement.objective`)."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Bool, Float
from core.geometry.boxes import Boxes
from core.placement.candidates import upright
from core.placement.objective import OBJECTIVE, Objective, Targets


@dataclass(frozen=True, eq=False)
class Terms:
    """Cost terms of B candidate boxes, all (B,)."""

    obstructed: Float
    salient: Float
    roll: Float
    curvature_deviation: Float
    rough: Float
    edge_proximity: Float
    folded: Float
    articulation: Float
    detail: Float
    busy: Float
    face: Bool
    feature: Bool
    preferred: Float
    last_resort: Bool
    distance: Float  # added to the mean distance between the surfaces, size-30 units


def cost(terms: Terms, objective: Objective = OBJECTIVE) -> Float:
    """(B,) cost of a mark in each box, in shares of all directions."""
    penalty = (
        objective.obstructed * terms.obstructed
        + objective.salient * terms.salient
        + objective.roll * terms.roll
        + objective.curvature_deviation * terms.curvature_deviation
        + objective.rough * terms.rough
        + objective.edge_proximity * terms.edge_proximity
        + objective.folded * terms.folded
        + objective.articulation * terms.articulation
        + objective.detail * terms.detail
        + objective.busy * terms.busy
        + np.maximum.reduce(
            [
                objective.face * terms.face,
                objective.feature * terms.feature,
                objective.last_resort * terms.last_resort,
            ]
        )
        - objective.preferred * terms.preferred
    )
    distorted = np.minimum(objective.distortion * terms.distance, objective.most_distorted)
    return np.asarray(objective.penalty * penalty + objective.mark + distorted)


def prices(terms: Terms, objective: Objective = OBJECTIVE) -> dict[str, Float]:
    """The shares of :func:`cost`, (B,) each, by the names of their terms; "mark" is the price of any mark, "distance"
    that of the changed shape."""
    named = {
        "obstructed": objective.obstructed * terms.obstructed,
        "salient": objective.salient * terms.salient,
        "roll": objective.roll * terms.roll,
        "curvature_deviation": objective.curvature_deviation * terms.curvature_deviation,
        "rough": objective.rough * terms.rough,
        "edge_proximity": objective.edge_proximity * terms.edge_proximity,
        "folded": objective.folded * terms.folded,
        "articulation": objective.articulation * terms.articulation,
        "detail": objective.detail * terms.detail,
        "busy": objective.busy * terms.busy,
    }
    last = ("face", "feature", "last_resort")  # of which the largest alone counts
    each = np.stack([np.asarray(getattr(objective, name) * getattr(terms, name), dtype=np.float64) for name in last])
    named |= {name: np.where(each.argmax(axis=0) == row, each[row], 0.0) for row, name in enumerate(last)}
    named["preferred"] = -objective.preferred * terms.preferred
    distorted = np.minimum(objective.distortion * terms.distance, objective.most_distorted)
    told = {name: np.asarray(objective.penalty * value) for name, value in named.items()}
    return told | {"mark": np.full(len(terms.salient), objective.mark), "distance": np.asarray(distorted)}


def obstructed(visible: Bool, faced: Bool, goal: Targets) -> Float:
    """(B,) weighted share of the directions each box faces (B, D) in which it is not ``visible`` (B, D)."""
    weight = goal.weight[: len(goal.directions)]
    return np.asarray(
        1 - (visible * weight).sum(axis=1) / np.maximum((faced * weight).sum(axis=1), np.finfo(float).tiny)
    )


def roll(boxes: Boxes) -> Float:
    """(B,) sine of the angle between a text's up and the asset's up as the text's plane shows it; 1 upside down."""
    level = np.einsum("bi,bi->b", boxes.axes[:, 1], upright(boxes.axes[:, 2])[:, 1])
    return np.asarray(np.sqrt(1 - np.clip(level, 0, 1) ** 2))


def curvature_deviation(boxes: Boxes, height: Float) -> Float:
    """(B,) root mean square ``height`` (B, N) of the surface above the middle plane over half the box's thickness;
    at most 1."""
    return np.asarray(np.minimum(np.sqrt((height**2).mean(axis=1)) / (boxes.size[:, 2] / 2), 1.0))


def distance(boxes: Boxes, relief: Float, ink: Float, area: float) -> Float:
    """(B,) estimate of the distance that each mark adds to the mean between the marked and the plain surface of an
    ``area``; its letters are ``relief`` (B,) high and cover the share ``ink`` (B,) of its box."""
    return np.asarray(ink * boxes.size[:, 0] * boxes.size[:, 1] * relief / area)
