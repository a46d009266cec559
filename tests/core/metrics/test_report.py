import json

import numpy as np
import pytest

from core.metrics.report import HIGHER_IS_BETTER, asset_facts, geometry_metrics
from tests.core.metrics.test_ray import on_all_sides
from tests.core.placement.shapes import cuboid, index_of, join, moved, plane

RELIEF = np.full(len(on_all_sides()), 0.2)


def test_the_report_carries_every_metric_and_says_which_way_is_better() -> None:
    block = cuboid(10, 10, 10)
    found = geometry_metrics(block, index_of(block), block, index_of(block), on_all_sides(), RELIEF)
    quality, utility = found["watermark_quality"], found["asset_utility"]
    assert list(quality) == ["wps", "wps_area", "ray", "ray_box", "coverage", "ocr", "ocr_ge_0.8", "ocr_exact"]
    assert list(utility) == ["smse", "smse_squared", "ipe", "lce", "se", "ss"]
    assert found["higher_is_better"].keys() == HIGHER_IS_BETTER.keys() == quality.keys() | utility.keys()
    assert quality["wps"] == 0
    assert quality["wps_area"] == pytest.approx(1)
    assert quality["ray"] == quality["ray_box"] == 1
    assert utility["smse"] == pytest.approx(0, abs=1e-9)
    assert utility["ipe"] == 0
    assert utility["lce"] is None
    json.dumps(found, allow_nan=False)


def test_damage_shows_in_the_asset_utility() -> None:
    block = cuboid(10, 10, 10)
    marked = join(block, moved(cuboid(1, 1, 0.1), shift=(0, 0, 6)))
    utility = geometry_metrics(block, index_of(block), marked, index_of(marked), on_all_sides(), RELIEF)[
        "asset_utility"
    ]
    assert utility["ipe"] == 1
    assert utility["smse"] == pytest.approx((1 * 0.95 + 1 * 1.05 + 0.4 * 1) / 602.4, rel=0.2)


def test_the_facts_of_an_asset_are_plain_numbers() -> None:
    facts = asset_facts(join(plane(2, 2), moved(cuboid(1, 1, 1), shift=(9, 0, 0))))
    assert facts == {
        "vertices": 12,
        "faces": 14,
        "components": 2,
        "watertight": False,
        "boundary_edges": 4,
        "nonmanifold_edges": 0,
    }
    json.dumps(facts)
