"""A document with nothing in it but what it shows."""

import json
from dataclasses import replace
from typing import Any

import numpy as np

from core.gltf.document import Document
from core.gltf.scene import flatten
from core.gltf.shown import VARIANTS, only_shown
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder
from tests.core.gltf.rich import rich
from tests.residue import residue
from tests.validator import error_counts


def cubes(nodes: list[dict[str, Any]], primitives: list[dict[str, Any]] | None = None, **objects: Any) -> Document:
    """Meshes of a cube each, one for each node but where it says which; the first with more ``primitives``."""
    builder = Builder()
    meshes: list[dict[str, Any]] = [
        {"name": f"mesh {number}", "primitives": [builder.primitive(np.array(CUBE) * (number + 1), CUBE_FACES)]}
        for number in range(len(nodes))
    ]
    for entry in primitives or []:
        meshes[0]["primitives"].append({**meshes[0]["primitives"][0], **entry})
    drawing = [{"mesh": number, **node} for number, node in enumerate(nodes)]
    return builder.document(**{"meshes": meshes, "nodes": drawing, "scenes": [{"nodes": [0]}]} | objects)


def names(document: Document) -> list[str]:
    return [mesh["name"] for mesh in document.json["meshes"]]


def test_hidden_nodes_levels_of_detail_other_scenes_and_unused_meshes_are_gone() -> None:
    document = cubes(
        [
            {"extensions": {"MSFT_lod": {"ids": [1]}}, "children": [2]},
            {},
            {"extensions": {"KHR_node_visibility": {"visible": False}}},
            {},
            {},
        ],
        scenes=[{"nodes": [0]}, {"name": "clean", "nodes": [3]}],
        extensionsUsed=["MSFT_lod", "KHR_node_visibility"],
    )
    shown, left_out = only_shown(replace(document, chunks=((b"MORE", b"a mesh, for all we know"),)))
    assert names(shown) == ["mesh 0"]
    assert left_out == []
    assert shown.chunks == ()
    assert len(shown.json["scenes"]) == 1
    assert len(flatten(shown).surface.faces) == 12
    assert residue(shown.to_glb()) == []
    assert len(shown.json["accessors"]) == 2
    assert not error_counts(shown.to_glb())


def test_what_it_shows_but_cannot_carry_marks_is_gone_and_named() -> None:
    document = cubes([{"children": [1]}, {}], [{"mode": 1}])
    document.json["meshes"][1]["primitives"][0]["mode"] = 0
    shown, left_out = only_shown(document)
    assert left_out == ["nodes[1]", "meshes[0].primitives[1]"]
    assert names(shown) == ["mesh 0"]
    assert len(shown.json["meshes"][0]["primitives"]) == 1


def test_variants_and_materials_that_are_not_drawn_are_gone_and_the_others_keep_their_numbers() -> None:
    document = cubes(
        [{}],
        materials=[{"name": "night"}, {"name": "day", "extensions": {"MSFT_lod": {"ids": [0]}}}, {"name": "dusk"}],
        extensionsUsed=[VARIANTS, "MSFT_lod"],
        extensions={VARIANTS: {"variants": [{"name": "night"}]}},
    )
    mapped = {VARIANTS: {"mappings": [{"material": 0, "variants": [0]}]}}
    document.json["meshes"][0]["primitives"][0] |= {"material": 1, "extensions": mapped}
    shown, _ = only_shown(document)
    assert shown.json["materials"] == [{}, {"name": "day"}, {}]
    assert VARIANTS not in json.dumps(shown.json)
    assert "extensionsUsed" not in shown.json


def test_of_a_rich_asset_all_that_its_scene_shows_is_there() -> None:
    before = rich()
    shown, left_out = only_shown(before)
    assert left_out == []
    assert np.array_equal(flatten(shown).surface.positions, flatten(before).surface.positions)
    for key in ("nodes", "skins", "animations", "materials", "textures", "cameras", "asset"):
        assert shown.json.get(key) == before.json.get(key)
