"""The metrics by name, and what was measured of them; without what measures them, which takes a while to load."""

from dataclasses import dataclass, field

from core.arrays import Float
from core.notices import Notice

Values = dict[str, float | int | None]

HIGHER_IS_BETTER = {
    "watermark_quality": {
        "wps": True,
        "wps_area": True,
        "ray": True,
        "ray_box": True,
        "coverage": True,
        "crop_survival": True,
        "prominence": True,
        "prominence_least": True,
        "label_height_share": True,
        "match": True,
        "ocr": True,
        "ocr_ge_0.8": True,
        "ocr_exact": True,
    },
    "asset_utility": {
        "smse": False,
        "smse_squared": False,
        "ipe": False,
        "lce": False,
        "lce_pooled": False,
        "se": False,
        "se_lee2005": False,
        "ss": True,
    },
}
# Of the size-30 frame; all other metrics are shares, similarities or counts.
UNITS = {
    "smse": "length",
    "smse_squared": "length^2",
    "lce": "length^2",
    "lce_pooled": "length^2",
    "ipe": "parts",
}


@dataclass
class Measurement:
    """All metrics by name; where one is None, ``missing`` says why.

    Attributes:
        values: by metric.
        missing: why there is no value, by metric.
        seconds: by group of metrics.
        semantics: what extracted the features of ``ss``; empty where it was not measured.
        warnings: what was measured otherwise than it could have been.
        read: (24,) how far the text was read in each of the paper's views; None where it was not measured.
        box_saliency: (B,) mean saliency under each mark; None where it was not measured.
    """

    values: Values = field(default_factory=lambda: {name: None for kind in HIGHER_IS_BETTER.values() for name in kind})
    missing: dict[str, Notice] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    semantics: str = ""
    warnings: list[Notice] = field(default_factory=list)
    read: Float | None = None
    box_saliency: Float | None = None
