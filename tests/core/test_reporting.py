"""The facts a report states about an asset."""

import json

from core.report import FileFacts
from core.reporting import asset_facts
from tests.core.placement.shapes import cuboid, join, moved, plane


def test_the_facts_of_an_asset_are_plain_numbers() -> None:
    file = FileFacts(sha256="00", bytes=5, format="stl")
    facts = asset_facts(file, join(plane(2, 2), moved(cuboid(1, 1, 1), shift=(9, 0, 0)))).model_dump(mode="json")
    assert facts == {
        "sha256": "00",
        "bytes": 5,
        "format": "stl",
        "vertices": 12,
        "faces": 14,
        "components": 2,
        "watertight": False,
        "boundary_edges": 4,
        "nonmanifold_edges": 0,
    }
    json.dumps(facts)
