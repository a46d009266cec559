"""Primitives of a scene carry their material, attributes, names and skin, each read once."""

from typing import Any

import numpy as np
import pytest

from core.analysis.color import appearance
from core.errors import ErrorCode, MeshmarkError
from core.gltf.scene import Scene, flatten
from tests.core.gltf.builder import CUBE, CUBE_FACES, QUAD, QUAD_FACES, Builder


def _scene(materials: list[dict[str, Any]] | None = None, nodes: list[dict[str, Any]] | None = None) -> Scene:
    """Two quads of one mesh, the first with the first material, the second with the last."""
    builder = Builder()
    primitives = [builder.primitive(QUAD, QUAD_FACES), builder.primitive(QUAD, QUAD_FACES)]
    if materials:
        primitives[0]["material"], primitives[1]["material"] = 0, len(materials) - 1
    nodes = nodes or [{"mesh": 0}]
    return flatten(
        builder.document(
            meshes=[{"name": "card", "primitives": primitives}],
            nodes=nodes,
            scenes=[{"nodes": list(range(len(nodes)))}],
            **({"materials": materials} if materials else {}),
        )
    )


def test_nodes_that_draw_one_mesh_share_its_primitives() -> None:
    scene = _scene(nodes=[{"mesh": 0}, {"mesh": 0, "translation": [3, 0, 0]}])
    one, two, again, too = (drawn.primitive for drawn in scene.primitives)
    assert (one, two) == (again, too)
    assert one is not two


def test_primitives_of_one_material_share_its_record() -> None:
    one, two = (drawn.primitive.material for drawn in _scene([{"name": "felt"}]).primitives)
    assert one is two
    assert (one.index, one.name) == (0, "felt")


def test_a_primitive_without_a_material_has_the_default_one() -> None:
    material = _scene().primitives[0].primitive.material
    assert (material.index, material.name, material.color.tolist()) == (None, "", [1, 1, 1, 1])


def test_a_material_that_does_not_exist_is_refused() -> None:
    builder = Builder()
    primitive = builder.primitive(QUAD, QUAD_FACES) | {"material": 3}
    with pytest.raises(MeshmarkError) as caught:
        flatten(builder.document(meshes=[{"primitives": [primitive]}], materials=[{}]))
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_names_that_are_no_text_count_as_none() -> None:
    scene = _scene([{"name": ["felt"]}], [{"mesh": 0, "name": 7}])
    assert scene.primitives[0].primitive.material.name == ""
    assert scene.primitives[0].node.name == ""


def test_attributes_and_morph_targets_are_those_of_the_file() -> None:
    builder = Builder()
    uv = builder.accessor(np.zeros((4, 2)))
    moved = {"POSITION": builder.accessor(np.zeros((4, 3)))}
    primitive = builder.primitive(QUAD, QUAD_FACES, TEXCOORD_1=uv) | {"targets": [moved]}
    (drawn,) = flatten(builder.document(meshes=[{"primitives": [primitive]}])).primitives
    assert drawn.primitive.attributes["TEXCOORD_1"] == uv
    assert drawn.primitive.maps == [primitive["attributes"], moved]


def test_the_skin_of_a_primitive_names_the_nodes_that_move_it() -> None:
    builder = Builder()
    influences = {
        "JOINTS_0": builder.accessor(np.tile([1, 0, 0, 0], (8, 1)), "u1"),
        "WEIGHTS_0": builder.accessor(np.tile([1.0, 0, 0, 0], (8, 1))),
    }
    mesh = {"primitives": [builder.primitive(CUBE, CUBE_FACES, **influences), builder.primitive(CUBE, CUBE_FACES)]}
    skinned, rigid = flatten(
        builder.document(
            meshes=[mesh],
            nodes=[{"mesh": 0, "skin": 0}, {}, {"translation": [0, 5, 0]}],
            scenes=[{"nodes": [0, 1, 2]}],
            skins=[{"joints": [1, 2]}],
        )
    ).primitives
    assert skinned.skin is not None
    assert skinned.skin.joints.tolist() == [1, 2]
    np.testing.assert_array_equal(skinned.skin.matrices[1, :, 3], [0, 5, 0])
    assert rigid.skin is None


def test_no_texture_is_decoded_before_its_colours_are_asked_for() -> None:
    builder = Builder()
    uv = builder.accessor(np.zeros((4, 2)))
    primitive = builder.primitive(QUAD, QUAD_FACES, TEXCOORD_0=uv) | {"material": 0}
    document = builder.document(
        meshes=[{"primitives": [primitive]}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        textures=[{"source": 0}],
        images=[{"bufferView": builder.view(b"no picture"), "mimeType": "image/png"}],
    )
    scene = flatten(document)
    assert scene.viewed.drawn.all()
    assert not document.undecoded
    assert scene.primitives[0].primitive.material.texture == 0
    points = scene.surface.positions[scene.surface.faces].mean(axis=1)
    appearance(scene, scene.surface, points, np.arange(2))
    assert document.undecoded == {0}
