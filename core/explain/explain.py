"""One placement, explained."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from core import marking
from core.arrays import Int
from core.budgets import DEFAULT_BUDGETS, Budgets
from core.embossing.refusal import EXPLAINED
from core.errors import MeshmarkError
from core.explain.trace import Trace
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.gltf.scene import Scene
from core.parameters import Parameters
from core.placement.cost import prices
from core.placement.rejection import REASONS, Stage
from core.reporting import boxes_of
from core.stages import Asset, Candidates, Embossed, Output, Request, Run

SCHEMA = "meshmark.explanation/1"
PROGRESS = {"reading": 0.05, "lettering": 0.05, "placing": 0.6, "embossing": 0.25, "writing": 0.05}  # shares of all


@dataclass(frozen=True, eq=False)
class Explanation:
    """One placement with all its steps.

    Attributes:
        surface: of the asset.
        trace: of the search.
        marks: boxes of the marks, size-30 units, in the order of the report.
        refused: boxes that were chosen, but could not be cut.
        scene: the asset with its marks; None where there are none.
        facts: ``meshmark.explanation/1``, see ``service/docs/command-line.md``.
        error: why there are no marks; None where there are.
    """

    surface: Surface
    trace: Trace
    marks: Boxes
    refused: Boxes
    scene: Scene | None
    facts: dict[str, Any]
    error: MeshmarkError | None = None


def explain(
    data: bytes,
    parameters: Parameters,
    font: bytes | None = None,
    logo: bytes | None = None,
    budgets: Budgets = DEFAULT_BUDGETS,
    progress: Callable[[str, float], None] = lambda _stage, _share: None,
) -> Explanation:
    """Mark an asset and keep why each mark stands where it stands; also where none finds a place.

    Args:
        data: the file.
        parameters: as for a job.
        font, logo, budgets: as for a job.
        progress: called with the stage and the share of everything that is done, 0 to 1.

    Raises:
        MeshmarkError: where the asset cannot be read or the text not be set.
    """
    trace = Trace()
    run = Run(
        Request(parameters.resolved(), font, logo, budgets, watch=trace), lambda _: None, lambda _name, _data: None
    )

    def begin(stage: str) -> None:
        before = sum(list(PROGRESS.values())[: list(PROGRESS).index(stage)])
        run.progress = lambda share: progress(stage, before + PROGRESS[stage] * min(share, 1.0))
        run.progress(0.0)

    begin("reading")
    asset = marking.read(data, budgets)
    begin("lettering")
    layouts = marking.letter(run)
    surface = asset.analysis.surface
    try:
        begin("placing")
        candidates = marking.place(asset, layouts, run)
        begin("embossing")
        embossed = marking.emboss(asset, candidates, run)
        begin("writing")
        output = marking.write_model(asset, candidates.ground, embossed, run)
    except MeshmarkError as error:
        facts = _facts(trace) | {"error": {"code": error.code, "message": error.message, "remedy": error.remedy}}
        return Explanation(surface, trace, Boxes.empty(), Boxes.empty(), None, facts, error)
    return explanation(asset, candidates, output, trace)


def explanation(asset: Asset, candidates: Candidates, output: Output, trace: Trace) -> Explanation:
    """The explanation of a placement that was watched from its beginning."""
    surface, shown = asset.analysis.surface, output.embossed
    assert shown is not None
    boxes, _ = boxes_of(shown.marks)
    refused = shown.placement.boxes[_numbers(shown.refusals)]
    facts = _facts(trace) | {
        "objective": shown.placement.value(list(shown.marks)),
        "marks": [
            _place(box, surface) | worth
            for box, worth in zip(_each(boxes), _worth(trace, candidates, shown), strict=True)
        ],
        "refused": [
            _place(box, surface) | {"reason": reason, "because": EXPLAINED[reason][0]}
            for box, reason in zip(_each(refused), shown.refusals.values(), strict=True)
        ],
    }
    return Explanation(surface, trace, boxes, refused, output.scene, facts)


def _facts(trace: Trace) -> dict[str, Any]:
    """Numbers of boxes by stage, over all searches and in each."""
    return {
        "schema": SCHEMA,
        "stages": [
            {
                "stage": stage,
                "left": len(trace.left(stage)),
                "dropped_because": REASONS[stage][0] if stage in REASONS else None,
            }
            for stage in Stage
        ],
        "searches": [
            {
                "width": float(next(iter(search.values())).size[:, 0].max(initial=0)),
                "moved": Stage.CANDIDATES not in search,
                "left": {stage: len(boxes) for stage, boxes in search.items()},
            }
            for search in trace.searches
        ],
        "objective": None,
        "marks": [],
        "refused": [],
        "error": None,
    }


def _worth(trace: Trace, candidates: Candidates, shown: Embossed) -> list[dict[str, Any]]:
    """For each mark what it adds to the objective and what it costs, term by term, in shares of all directions; and the
    number of views that it is visible in."""
    placement, chosen = shown.placement, list(shown.marks)
    costs = prices(trace.terms(placement.boxes[_numbers(chosen)]), candidates.context.options.objective)
    pairs = placement.pairs(chosen)[chosen].sum(axis=1)
    gain = np.diagonal(placement.gain_without(chosen, np.array(chosen)))
    covers = gain + placement.cost[chosen] + pairs
    views = placement.visible[chosen][:, : len(candidates.context.targets.up)].sum(axis=1)
    return [
        {
            "covers": round(float(covers[number]), 6),
            "costs": {name: round(float(each[number]), 6) for name, each in costs.items() if abs(each[number]) > 5e-7},
            "beside_others": round(float(pairs[number]), 6),
            "views": int(views[number]),
        }
        for number in range(len(chosen))
    ]


def _place(box: Boxes, surface: Surface) -> dict[str, Any]:
    """Place of a box in the world's coordinates, and its width, size-30 units."""
    return {
        "center": [float(value) for value in surface.to_world(box.center)[0]],
        "normal": [float(value) for value in box.axes[0, 2]],
        "width": round(float(box.size[0, 0]), 4),
    }


def _numbers(boxes: Iterable[int]) -> Int:
    return np.array(list(boxes), dtype=np.int64)


def _each(boxes: Boxes) -> list[Boxes]:
    return [boxes[number : number + 1] for number in range(len(boxes))]
