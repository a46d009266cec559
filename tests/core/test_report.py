"""The facts a report states about an asset."""

import json

from core.report import asset_facts
from tests.core.placement.shapes import cuboid, join, moved, plane


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
