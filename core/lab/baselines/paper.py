"""The paper's own pipeline, re-implemented from its text, and the three ablations of its Table 2.

Candidates at 300 area samples thinned to radius 1, Adam with its constants, its filters in its order, Curve Matching
Fusion by booleans with the whole mesh. All draws of the shared parts come from the prepared asset's seed and the rest
from the given generator: the same seeds give the same mesh.
"""

import numpy as np

from core.geometry.boxes import Boxes
from core.lab.baselines.paper_filters import paper_filters
from core.lab.baselines.strategy import THICKNESS, Marked, Prepared, text_width
from core.lab.baselines.whole_boolean import fuse_curved, fuse_flat
from core.parameters import Parameters
from core.placement.filters import well_aligned

RANKED = 0.5  # share of boxes that pass the alignment filter where it ranks them


def paper(prepared: Prepared, parameters: Parameters, rng: np.random.Generator) -> Marked:
    """Boxes by Adam and the paper's filters, curve-matched letters of the requested height (the paper's is 0.05).

    Raises:
        MeshmarkError: ``no_faces``, ``no_placement``, ``not_manifold``.
    """
    return _curved(prepared, parameters, _filtered(prepared, parameters, rng))


def paper_no_curve_matching(prepared: Prepared, parameters: Parameters, rng: np.random.Generator) -> Marked:
    """The boxes of :func:`paper`, with flat text united as in :func:`core.lab.baselines.li.li`."""
    boxes = _filtered(prepared, parameters, rng)
    mesh = fuse_flat(prepared.solid, prepared.artwork, boxes)
    return Marked(mesh, boxes, np.full(len(boxes), THICKNESS / 2))


def paper_no_optimization(prepared: Prepared, parameters: Parameters, rng: np.random.Generator) -> Marked:
    """The candidates go to the filters as they were sampled.

    Hardly any has a loss below 0.005 then, so the alignment filter ranks instead: the better half passes.
    """
    boxes, loss = prepared.initial(text_width(parameters))
    aligned = loss <= np.quantile(loss, RANKED)
    assert parameters.count is not None
    return _curved(prepared, parameters, paper_filters(prepared, boxes, aligned, parameters.count, rng))


def paper_no_filtering(prepared: Prepared, parameters: Parameters, rng: np.random.Generator) -> Marked:
    """``count`` of the optimised boxes at random, also badly aligned, hidden or overlapping ones."""
    boxes, _ = prepared.fitted(text_width(parameters))
    assert parameters.count is not None
    picked = rng.permutation(len(boxes))[: parameters.count]
    return _curved(prepared, parameters, boxes[picked])


def _filtered(prepared: Prepared, parameters: Parameters, rng: np.random.Generator) -> Boxes:
    boxes, loss = prepared.fitted(text_width(parameters))
    assert parameters.count is not None
    return paper_filters(prepared, boxes, well_aligned(loss), parameters.count, rng)


def _curved(prepared: Prepared, parameters: Parameters, boxes: Boxes) -> Marked:
    relief = abs(parameters.relief_at(text_width(parameters) * prepared.artwork.aspect))
    mesh = fuse_curved(prepared.solid, prepared.artwork, boxes, prepared.surface, prepared.index, relief)
    return Marked(mesh, boxes, np.full(len(boxes), relief))
