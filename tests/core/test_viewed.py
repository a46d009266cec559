"""Marks stand where a viewer draws them, whatever a file says about sides, alpha, nodes and scale; judged by the
triangles of the marked file alone."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.arrays import Float
from core.choices import Evaluate, Mode
from core.parameters import Parameters
from core.pipeline import watermark
from tests.core.rendering.glb import CORNERS, CUBE_FACES, QUAD, QUAD_FACES, QUAD_UV, GlbWriter, plain, png
from tests.drawn import undrawn

INWARDS = CUBE_FACES[:, ::-1]
GLASS = plain((1, 1, 1, 0.2), alphaMode="BLEND")
NOTHING = plain((1, 1, 1, 0.0), alphaMode="BLEND")
ASKED = Parameters(text="hi", count=4, size=1.5, evaluate=Evaluate.NONE)


def _marked(writer: GlbWriter, **more: Any) -> dict[str, Any]:
    """The report on a document; every mark in it is drawn."""
    data = writer.bytes()
    result = watermark(data, ASKED.model_copy(update=more), preview=False)
    assert result.report["watermarks"]
    assert all(mark["drawn"] for mark in result.report["watermarks"])
    assert undrawn(result.model, result.report["watermarks"], data) == []
    return result.report


def _centers(report: dict[str, Any]) -> Float:
    return np.array([mark["center"] for mark in report["watermarks"]])


def _facing(report: dict[str, Any]) -> Float:
    """(B,) positive where a mark looks away from the origin."""
    return np.asarray(np.einsum("bi,bi->b", _centers(report), [mark["normal"] for mark in report["watermarks"]]))


@pytest.mark.parametrize("mode", [Mode.EMBOSS, Mode.DEBOSS])
def test_a_room_is_marked_where_people_look_into_it(mode: Mode) -> None:
    room = GlbWriter().mesh(CORNERS * 4, INWARDS).mesh(CORNERS / 2 - (0, 3.5, 0), CUBE_FACES)
    report = _marked(room, mode=mode)
    on_walls = np.abs(_centers(report)).max(axis=1) > 3.9
    assert on_walls.any()
    assert (_facing(report)[on_walls] < 0).all()


def test_a_room_whose_walls_have_two_sides_is_marked_outside() -> None:
    report = _marked(GlbWriter().mesh(CORNERS * 4, INWARDS, material={"doubleSided": True}))
    assert (_facing(report) > 0).all()


def test_the_body_in_a_toon_hull_and_below_a_sky_is_marked() -> None:
    scene = GlbWriter().mesh(CORNERS, CUBE_FACES).mesh(CORNERS * 1.03, INWARDS).mesh(CORNERS * 2.5, INWARDS)
    report = _marked(scene, count=12)
    on_the_body = np.abs(np.abs(_centers(report)).max(axis=1) - 1) < 0.02
    assert on_the_body.any()
    assert (_facing(report)[on_the_body] > 0).all()


@pytest.mark.parametrize("hidden", [{"material": NOTHING}, {"extensions": {"KHR_node_visibility": {"visible": False}}}])
def test_a_collider_that_nobody_sees_carries_nothing(hidden: dict[str, Any]) -> None:
    report = _marked(GlbWriter().mesh(CORNERS, CUBE_FACES).mesh(CORNERS * 2, CUBE_FACES, **hidden))
    on_the_body = (np.abs(_centers(report)) < 1.1).all(axis=1)
    assert np.count_nonzero(on_the_body) >= 3
    assert report["units"]["scale"] == 15


@pytest.mark.parametrize("mode", ["BLEND", "MASK"])
def test_an_opaque_body_is_marked_whatever_mode_its_exporter_wrote(mode: str) -> None:
    body = plain((0.8, 0.5, 0.4, 1), alphaMode=mode)
    knob = CORNERS / 5 + (0, 0, 1.2)
    report = _marked(GlbWriter().mesh(CORNERS, CUBE_FACES, material=body).mesh(knob, CUBE_FACES))
    assert (np.abs(_centers(report)).max(axis=1) < 1.1).all()
    assert not report["warnings"]


def test_what_stands_in_a_showcase_is_marked_and_not_its_glass() -> None:
    report = _marked(GlbWriter().mesh(CORNERS, CUBE_FACES).mesh(CORNERS * 1.6, CUBE_FACES, material=GLASS))
    on_the_body = (np.abs(_centers(report)) < 1.1).all(axis=1)
    assert np.count_nonzero(on_the_body) >= 3


def test_glass_is_marked_where_there_is_nothing_else_and_the_report_says_so() -> None:
    report = _marked(GlbWriter().mesh(CORNERS, CUBE_FACES, material=GLASS))
    assert [warning["code"] for warning in report["warnings"]] == ["see_through_surface"]


@pytest.mark.parametrize("mode", ["BLEND", "MASK"])
def test_letters_stand_on_the_opaque_part_of_a_picture_with_holes(mode: str) -> None:
    writer = GlbWriter()
    image = writer.image_texture(png([[(90, 90, 90, 255), (90, 90, 90, 0)]]), magFilter=9728)
    material = {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorTexture": {"index": image}}, "doubleSided": True}
    report = _marked(writer.mesh(QUAD, QUAD_FACES, {"TEXCOORD_0": QUAD_UV}, material))
    assert (_centers(report)[:, 0] < -0.05).all()
    assert not report["warnings"]


def test_a_part_in_odd_coordinates_does_not_keep_the_others_from_being_marked() -> None:
    odd = CORNERS / 4 + np.float32(17000)
    report = _marked(GlbWriter().mesh(CORNERS, CUBE_FACES).mesh(odd, CUBE_FACES, translation=[-17000, -17000, -16998]))
    on_the_body = (np.abs(_centers(report)) < 1.1).all(axis=1)
    assert np.count_nonzero(on_the_body) >= 3


_ENTRY = st.floats(-0.4, 0.4)
_PART = st.tuples(
    st.tuples(*[_ENTRY] * 6),  # shear
    st.tuples(*[st.sampled_from([-1.0, -0.6, 0.6, 1.0])] * 3),  # stretch and mirrors
    st.booleans(),  # wound inwards
    st.booleans(),  # double-sided
    st.sampled_from([("OPAQUE", 0.0), ("BLEND", 1.0), ("BLEND", 0.3), ("BLEND", 0.0), ("MASK", 0.4), ("MASK", 0.6)]),
    st.booleans(),  # visible
)


def _document(parts: list[Any]) -> GlbWriter:
    writer = GlbWriter()
    for number, (shear, stretch, inwards, double_sided, (mode, alpha), visible) in enumerate(parts):
        matrix = np.eye(4)
        matrix[:3, :3][~np.eye(3, dtype=bool)] = shear
        matrix[:3, :3] *= stretch
        matrix[0, 3] = 3.0 * number
        writer.mesh(
            CORNERS,
            INWARDS if inwards else CUBE_FACES,
            material=plain((0.7, 0.7, 0.7, alpha), alphaMode=mode, doubleSided=double_sided),
            matrix=matrix.T.ravel().tolist(),
            extensions={"KHR_node_visibility": {"visible": visible}},
        )
    return writer


def _is_there(part: Any) -> bool:
    *_, (mode, alpha), visible = part
    return bool(visible and (mode == "OPAQUE" or (alpha > 0.5 if mode == "MASK" else alpha > 0)))


@settings(max_examples=6, derandomize=True)
@given(st.lists(_PART, min_size=1, max_size=3).filter(lambda parts: any(map(_is_there, parts))))
def test_whatever_nodes_and_materials_do_the_marks_of_the_report_are_drawn(parts: list[Any]) -> None:
    _marked(_document(parts), count=3)
