"""Li et al. 2024 as the paper re-purposes it: flat text at random places."""

import numpy as np

from core.geometry.sampling import sample
from core.lab.baselines.strategy import THICKNESS, Marked, Prepared, text_width
from core.lab.baselines.whole_boolean import fuse_flat
from core.parameters import Parameters


def li(prepared: Prepared, parameters: Parameters, rng: np.random.Generator) -> Marked:
    """Exactly ``count`` marks at uniform area samples, along the normals there, by a plain boolean union.

    No fine-tuning, no filters, no curvature matching; marks may overlap. The text is 0.5 thick and half sunk, so its
    relief is 0.25, not that of the parameters (paper, sections "Baseline Methods" and "Implementation Details").

    Raises:
        MeshmarkError: ``no_faces``, ``not_manifold``.
    """
    assert parameters.count is not None
    points, face = sample(prepared.surface, parameters.count, rng)
    boxes = prepared.boxes_at(points, face, text_width(parameters))
    mesh = fuse_flat(prepared.solid, prepared.artwork, boxes)
    return Marked(mesh, boxes, np.full(len(boxes), THICKNESS / 2))
