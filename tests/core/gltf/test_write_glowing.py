"""Letters on sources that light does not change: unlit materials, and emission."""

from typing import Any

import numpy as np
import pytest

from core.gltf.document import Document
from core.gltf.edit import Kind, Style
from core.gltf.scene import flatten
from core.gltf.write import write
from tests.core.gltf.builder import QUAD, QUAD_FACES, Builder
from tests.core.gltf.edited import primitives_of
from tests.core.gltf.edits import centroid_split
from tests.validator import error_counts

UNLIT = "KHR_materials_unlit"


def letters(source: dict[str, Any], glows: bool = False, declared: bool = True) -> Document:
    """A square of the material ``source`` with one mark of orange letters."""
    builder = Builder()
    primitive = builder.primitive(QUAD, QUAD_FACES) | {"material": 0}
    used = {"extensionsUsed": [UNLIT]} if declared and UNLIT in source.get("extensions", {}) else {}
    document = builder.document(meshes=[{"primitives": [primitive]}], materials=[source], **used)
    scene = flatten(document)
    glb = write(scene, centroid_split(scene, [0], [Kind.CAP]), [Style("#ff8000", glows)])
    assert not error_counts(glb)
    return Document.from_glb(glb)


def material_of_letters(document: Document) -> dict[str, Any]:
    material: dict[str, Any] = document.json["materials"][primitives_of(document)[1]["material"]]
    return material


@pytest.mark.parametrize("declared", [True, False])
def test_letters_of_an_unlit_source_are_unlit(declared: bool) -> None:
    document = letters({"extensions": {UNLIT: {}}, "alphaMode": "MASK"}, declared=declared)
    material = material_of_letters(document)
    assert material["extensions"] == {UNLIT: {}}
    np.testing.assert_allclose(material["pbrMetallicRoughness"]["baseColorFactor"], [1, 0.215861, 0, 1], atol=1e-6)
    assert document.json["extensionsUsed"] == [UNLIT]


def test_letters_of_a_lit_source_are_lit() -> None:
    document = letters({"emissiveFactor": [1, 1, 1]})
    assert not {"extensions", "emissiveFactor"} & material_of_letters(document).keys()
    assert "extensionsUsed" not in document.json


def test_letters_that_glow_give_their_colour_off_as_light_and_reflect_none() -> None:
    material = material_of_letters(letters({"emissiveFactor": [0.1, 0.1, 0.1], "doubleSided": True}, True))
    np.testing.assert_allclose(material["emissiveFactor"], [1, 0.215861, 0], atol=1e-6)
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == [0, 0, 0, 1]
    assert material["doubleSided"]


def test_unlit_letters_need_no_light_of_their_own() -> None:
    source = {"extensions": {UNLIT: {}}, "alphaMode": "MASK"}
    assert "emissiveFactor" not in material_of_letters(letters(source, True))


def test_marks_of_one_colour_share_a_material_only_where_both_glow() -> None:
    builder = Builder()
    mesh = {"primitives": [builder.primitive(QUAD, QUAD_FACES) | {"material": 0}]}
    scene = flatten(builder.document(meshes=[mesh], materials=[{"alphaMode": "BLEND"}]))
    edit = centroid_split(scene, [0, 1], [Kind.CAP, Kind.CAP])
    edit.mark[:] = np.searchsorted([0, 1], edit.source_face)
    result = Document.from_glb(write(scene, edit, [Style("#ff8000"), Style("#ff8000", glows=True)]))
    assert [primitive.get("material") for primitive in primitives_of(result)] == [1, 2]
    assert ["emissiveFactor" in material for material in result.json["materials"][1:]] == [False, True]
