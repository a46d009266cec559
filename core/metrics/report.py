"""All metrics of one watermarked asset in the report's form (``meshmark.report/1``)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.asset.surface import Surface
from core.metrics.coverage import coverage
from core.metrics.ipe import ipe
from core.metrics.lce import lce
from core.metrics.ray import ray
from core.metrics.sight import above_letters, top_face
from core.metrics.smse import smse
from core.metrics.topology import topology
from core.metrics.wps import wps
from core.metrics.wps_area import wps_area
from core.placement.boxes import Boxes
from core.spatial import SpatialIndex

HIGHER_IS_BETTER = {
    "wps": True,
    "wps_area": True,
    "ray": True,
    "ray_box": True,
    "coverage": True,
    "ocr": True,
    "ocr_ge_0.8": True,
    "ocr_exact": True,
    "smse": False,
    "smse_squared": False,
    "ipe": False,
    "lce": False,
    "se": False,
    "ss": True,
}


def geometry_metrics(
    original: Surface,
    original_index: SpatialIndex,
    watermarked: Surface,
    watermarked_index: SpatialIndex,
    boxes: Boxes,
    relief: NDArray[np.float64],
    seed: int = 0,
) -> dict[str, Any]:
    """The report's ``metrics`` without those that look at pictures or saliency, which are None.

    Args:
        original: the asset as it came.
        original_index: over ``original``.
        watermarked: the result in the same size-30 frame.
        watermarked_index: over ``watermarked``.
        boxes: the marks that were embossed, at least one.
        relief: (B,) height of each mark's letters, size-30 units.
        seed: of the area samples.
    """
    letters = above_letters(original, original_index, boxes, relief)
    distance, squared = smse(original_index, watermarked, np.random.default_rng(seed))
    return {
        "watermark_quality": {
            "wps": float(wps(original, boxes).mean()),
            "wps_area": float(wps_area(original, boxes).mean()),
            "ray": ray(boxes, letters, watermarked_index),
            "ray_box": ray(boxes, top_face(boxes), watermarked_index),
            "coverage": coverage(boxes, letters, watermarked_index),
            "ocr": None,
            "ocr_ge_0.8": None,
            "ocr_exact": None,
        },
        "asset_utility": {
            "smse": distance,
            "smse_squared": squared,
            "ipe": ipe(original, watermarked),
            "lce": lce(original_index, watermarked, boxes, relief),
            "se": None,
            "ss": None,
        },
        "higher_is_better": HIGHER_IS_BETTER,
    }


def asset_facts(surface: Surface) -> dict[str, Any]:
    """Size and topology of a surface for the report: counts, and whether it is closed."""
    found = topology(surface)
    return {
        "vertices": len(surface.positions),
        "faces": len(surface.faces),
        "components": found.components,
        "watertight": found.watertight,
        "boundary_edges": found.boundary_edges,
        "nonmanifold_edges": found.nonmanifold_edges,
    }
