"""A written file is looked at before anybody gets it: here two letters are a square's two triangles."""

from typing import Any

import numpy as np
import pytest

from core.analysis.analyse import HIDING
from core.embossing.drawn import drawn_marks
from core.gltf.edit import Kind, SurfaceEdit
from core.gltf.scene import Scene, scene_of
from tests.core.rendering.glb import QUAD, QUAD_FACES, QUAD_UV, GlbWriter, plain, png

BACKWARDS = np.array(QUAD_FACES)[:, ::-1]


def _file(faces: Any = QUAD_FACES, material: dict[str, Any] | None = None, **node: Any) -> Scene:
    """The square, and something plain that nothing is asked about."""
    writer = GlbWriter().mesh(QUAD - (0, 0, 0.5), QUAD_FACES)
    image = writer.image_texture(png([[(255, 255, 255, 255), (255, 255, 255, 0)]]), magFilter=9728)
    if material and "picture" in material:
        material = {"alphaMode": material["picture"], "pbrMetallicRoughness": {"baseColorTexture": {"index": image}}}
    writer.mesh(QUAD, faces, {"TEXCOORD_0": QUAD_UV}, material, **node)
    return scene_of(writer.bytes())


def _drawn(written: Scene, marks: tuple[int, int] = (0, 0), opaque: float = HIDING) -> list[bool]:
    asset = _file()
    surface, mine = asset.surface, np.flatnonzero(asset.surface.face_primitive == 1)
    corners = surface.faces[mine]
    edit = SurfaceEdit(
        keep=np.arange(4) < 2,
        vertex=corners,
        position=surface.positions[corners],
        source_face=mine,
        corner_face=np.repeat(mine[:, None], 3, axis=1),
        barycentric=np.tile(np.eye(3), (2, 1, 1)),
        original=corners,
        tilt=np.zeros((2, 3, 3)),
        kind=np.full(2, Kind.CAP, dtype=np.int8),
        mark=np.array(marks),
    )
    resolution = np.full(len(surface.positions), 1e-6)
    return list(drawn_marks(edit, max(marks) + 1, surface, resolution, written, opaque).tolist())


def test_letters_that_face_out_are_drawn() -> None:
    assert _drawn(_file()) == [True]


def test_letters_whose_backs_look_out_are_drawn_only_where_the_material_is_double_sided() -> None:
    assert _drawn(_file(BACKWARDS)) == [False]
    assert _drawn(_file(BACKWARDS, {"doubleSided": True})) == [True]


def test_a_mirroring_node_turns_the_winding_over() -> None:
    swap: dict[str, Any] = {
        "matrix": [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    }  # of x and y: the square stays where it is
    assert _drawn(_file(**swap)) == [True]
    assert _drawn(_file(BACKWARDS, **swap)) == [False]


@pytest.mark.parametrize(
    "material",
    [plain((1, 1, 1, 0.2), alphaMode="BLEND"), plain((1, 1, 1, 0.2), alphaMode="MASK")],
    ids=["glass", "a hole"],
)
def test_letters_on_glass_are_not_drawn_where_something_opaque_was_to_carry_them(material: dict[str, Any]) -> None:
    assert _drawn(_file(material=material)) == [False]


def test_letters_on_glass_are_drawn_where_nothing_else_could_carry_them_but_clear_ones_never() -> None:
    assert _drawn(_file(material=plain((1, 1, 1, 0.2), alphaMode="BLEND")), opaque=0.0) == [True]
    assert _drawn(_file(material=plain((1, 1, 1, 0.0), alphaMode="BLEND")), opaque=0.0) == [False]


def test_letters_of_a_hidden_node_are_not_drawn() -> None:
    assert _drawn(_file(extensions={"KHR_node_visibility": {"visible": False}})) == [False]


def test_letters_that_are_not_in_the_file_are_not_drawn() -> None:
    assert _drawn(_file(translation=[0, 0, 0.01])) == [False]


def test_each_mark_is_judged_by_its_own_letters() -> None:
    half = np.array([QUAD_FACES[0], QUAD_FACES[1][::-1]])
    assert _drawn(_file(half), marks=(0, 1)) == [True, False]
    assert _drawn(_file(half), marks=(0, 0)) == [False]
