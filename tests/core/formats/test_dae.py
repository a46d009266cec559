import contextlib
import re
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.budgets import Budgets
from core.errors import Code, ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.dae_scan import Scan
from core.gltf.document import Document
from core.gltf.scene import flatten
from tests.core.formats.samples import DAE, dae, png, zipped
from tests.validator import error_counts

USE = '<instance_geometry url="#g"/>'
BOUND = (
    '<node id="n"><instance_geometry url="#g"><bind_material><technique_common>'
    '<instance_material symbol="paint" target="#m"/></technique_common></bind_material></instance_geometry></node>'
)


def _materials(diffuse: str, path: str = "tex/a%20b.png") -> str:
    return (
        f'<library_images><image id="i"><init_from>{path}</init_from></image></library_images>'
        '<library_effects><effect id="e"><profile_COMMON>'
        '<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>'
        '<newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>'
        f'<technique sid="c"><lambert><diffuse>{diffuse}</diffuse></lambert></technique></profile_COMMON></effect>'
        '</library_effects><library_materials><material id="m"><instance_effect url="#e"/></material>'
        "</library_materials>"
    )


TEXTURED = dae(BOUND, materials=_materials('<texture texture="t" texcoord="UV"/>'))


def _convert(data: bytes) -> Document:
    document = document_of(admit(data))
    assert not error_counts(document.to_glb())
    return document


def _failure(data: bytes) -> Code:
    with pytest.raises(MeshmarkError) as caught:
        document_of(admit(data))
    return caught.value.code


@pytest.mark.parametrize(("axis", "center"), [("Y_UP", [1, 2, 3]), ("Z_UP", [1, 3, -2]), ("X_UP", [-2, 1, 3])])
def test_the_up_axis_and_the_unit_are_honoured(axis: str, center: list[float]) -> None:
    nodes = f"<node><translate>1 2 3</translate>{USE}</node>"
    surface = flatten(_convert(dae(nodes, f'<unit meter="0.01"/><up_axis>{axis}</up_axis>'))).surface
    world = surface.to_world(surface.positions)
    np.testing.assert_allclose((world.min(axis=0) + world.max(axis=0)) / 2, np.array(center) / 100, atol=1e-7)
    np.testing.assert_allclose(np.ptp(world, axis=0), 0.02, rtol=1e-5)


def test_nested_nodes_and_instances_are_placed() -> None:
    library = f'<library_nodes><node id="lib"><scale>2 2 2</scale>{USE}</node></library_nodes>'
    inner = '<node><translate>0 5 0</translate><instance_node url="#lib"/></node>'
    nodes = f"<node><translate>10 0 0</translate>{USE}{inner}</node>"
    document = _convert(dae(nodes, extra=library))
    assert [node["name"] for node in document.json["nodes"]] == ["cube", "cube"]
    surface = flatten(document).surface
    world = surface.to_world(surface.positions)
    centers = [world[surface.faces[surface.face_primitive == number]].mean(axis=(0, 1)) for number in range(2)]
    np.testing.assert_allclose(centers, [[10, 0, 0], [10, 5, 0]], atol=1e-5)


def test_a_colour_becomes_a_material() -> None:
    document = _convert(dae(BOUND, materials=_materials("<color>1 0.5 0 1</color>")))
    surface = document.json["materials"][0]["pbrMetallicRoughness"]
    assert surface["baseColorFactor"] == pytest.approx([1, 0.2122, 0, 1], abs=0.01)


def test_a_texture_of_the_archive_keeps_its_bytes_and_is_never_decoded() -> None:
    image = png(1, 2, 3)[:-20]  # damaged: whoever decodes it fails
    document = _convert_unchecked(zipped({"a/x.dae": TEXTURED, "a/tex/a b.png": image}))
    assert document.warnings == []
    assert document.binary.count(image) == 1
    assert "baseColorTexture" in document.json["materials"][0]["pbrMetallicRoughness"]


@pytest.mark.parametrize(
    "path", ["wood #2 gr\u00fcn.png", "wood%20%232%20gr%C3%BCn.png", "C:\\me\\Wood #2 GR\u00dcN.png"]
)
def test_a_texture_is_found_however_its_name_is_written(path: str) -> None:
    data = dae(BOUND, materials=_materials('<texture texture="t" texcoord="UV"/>', path))
    document = _convert(zipped({"a/x.dae": data, "a/wood #2 gru\u0308n.png": png(1, 2, 3), "other.png": png(4, 5, 6)}))
    assert document.warnings == []
    assert document.binary.count(png(1, 2, 3)) == 1


def _convert_unchecked(data: bytes) -> Document:
    return document_of(admit(data))


@pytest.mark.parametrize(
    ("path", "code"),
    [
        ("tex/a.png", ErrorCode.UNSUPPORTED_FEATURE),
        ("/etc/hostname", ErrorCode.UNSUPPORTED_FEATURE),
        ("http://127.0.0.1:1/a.png", ErrorCode.EXTERNAL_REFERENCE),
        ("file:///etc/hostname", ErrorCode.EXTERNAL_REFERENCE),
    ],
)
def test_a_texture_outside_the_upload_is_said_and_never_opened(path: str, code: ErrorCode) -> None:
    data = dae(BOUND, materials=_materials('<texture texture="t" texcoord="UV"/>', path))
    document_of(admit(data))  # everything is imported now
    with mock.patch("builtins.open", side_effect=AssertionError("opened a file")):
        document = document_of(admit(data))
    assert [warning.code for warning in document.warnings] == [code]


def test_cameras_lights_and_animations_that_are_not_read_are_said() -> None:
    nodes = f'<node>{USE}</node><node><instance_camera url="#c"/><instance_light url="#l"/></node>'
    animated = dae(nodes).replace(b"</COLLADA>", b"<library_animations><animation/></library_animations></COLLADA>")
    messages = [warning.message for warning in document_of(admit(animated)).warnings]
    assert [message.split(" has ")[1].split(",")[0] for message in messages] == ["animations", "cameras", "lights"]


def _controllers(*entries: tuple[str, str, str]) -> str:
    """(id, skin or morph, source); a skin moves by (1, 2, 3)."""
    matrix = "<bind_shape_matrix>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</bind_shape_matrix>"
    bodies = (
        f'<controller id="{key}"><{kind} source="#{source}">{matrix if kind == "skin" else ""}</{kind}></controller>'
        for key, kind, source in entries
    )
    return f"<library_controllers>{''.join(bodies)}</library_controllers>"


def _controlled(key: str) -> str:
    return BOUND.replace("instance_geometry", "instance_controller").replace("#g", f"#{key}")


def _centers(document: Document) -> list[list[float]]:
    surface = flatten(document).surface
    world = surface.to_world(surface.positions)
    count = int(surface.face_primitive.max()) + 1
    boxes = [world[surface.faces[surface.face_primitive == number]].reshape(-1, 3) for number in range(count)]
    return [((box.min(axis=0) + box.max(axis=0)) / 2).round(5).tolist() for box in boxes]


RED = _materials("<color>1 0 0 1</color>")
PLACED = '<node id="n"><translate>10 0 0</translate>'


@pytest.mark.parametrize(
    ("entries", "center"),
    [
        ([("c", "skin", "g")], [1, 2, 3]),  # where its joints are, not its node
        ([("c", "morph", "g")], [10, 0, 0]),
        ([("c", "skin", "m"), ("m", "morph", "g")], [1, 2, 3]),
        ([("c", "morph", "s"), ("s", "skin", "g")], [1, 2, 3]),
    ],
)
def test_a_body_in_skins_or_morphs_stays_in_bind_pose(entries: list[tuple[str, str, str]], center: list[int]) -> None:
    nodes = _controlled("c").replace('<node id="n">', PLACED)
    document = _convert(dae(nodes, materials=RED, extra=_controllers(*entries)))
    assert _centers(document) == [center]
    assert document.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] == [1, 0, 0, 1]
    assert ["bind pose" in warning.message for warning in document.warnings] == [True]


def test_bodies_with_and_without_a_skin_stand_side_by_side() -> None:
    skeleton = _controlled("c").replace("<bind_material>", "<skeleton>#joint</skeleton><bind_material>")
    library = f'<library_nodes><node id="lib">{skeleton}</node></library_nodes>'
    nodes = f'{skeleton}<node>{USE}</node><node><translate>5 0 0</translate><instance_node url="#lib"/></node>'
    document = _convert(dae(nodes, materials=RED, extra=library + _controllers(("c", "skin", "g"))))
    assert sorted(_centers(document)) == [[0, 0, 0], [1, 2, 3], [6, 2, 3]]


@pytest.mark.parametrize("shape", ["", "1 2 3", "x", " ".join(["nan"] * 16)])
def test_a_damaged_skin_does_not_cost_the_body(shape: str) -> None:
    skin = f'<controller id="c"><skin source="#g"><bind_shape_matrix>{shape}</bind_shape_matrix><v>1 x</v></skin>'
    extra = f"<library_controllers>{skin}</controller></library_controllers><library_animations><animation/>"
    data = dae(_controlled("c"), materials=RED, extra=extra + "</library_animations>")
    assert _centers(_convert(data)) == [[0, 0, 0]]


def test_a_controller_of_nothing_costs_nothing_else() -> None:
    document = _convert(dae(f'<node>{USE}<instance_controller url="#skin"/></node>'))
    assert _centers(document) == [[0, 0, 0]]
    assert "skinned" in document.warnings[0].message


def test_triangles_of_controlled_bodies_are_counted_before_anything_is_loaded() -> None:
    data = dae(_controlled("c") * 3, extra=_controllers(("c", "skin", "g")))
    with pytest.raises(MeshmarkError, match="36 triangles"):
        Scan(data, Budgets(faces=35))


def test_controllers_in_a_circle_are_refused() -> None:
    data = dae(_controlled("c"), extra=_controllers(("c", "skin", "d"), ("d", "morph", "c")))
    with pytest.raises(MeshmarkError, match="controllers") as caught:
        admit(data)
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def _transparent(mode: str | None, color: str | None, amount: float | None) -> str:
    opaque = f' opaque="{mode}"' if mode else ""
    text = f"<transparent{opaque}><color>{color}</color></transparent>" if color is not None else ""
    return text + (f"<transparency><float>{amount}</float></transparency>" if amount is not None else "")


@pytest.mark.parametrize(
    ("transparency", "alpha"),
    [
        (_transparent("A_ONE", "1 1 1 1", 0.3), 0.3),
        (_transparent("A_ONE", "0 0 0 0.3", None), 0.3),
        (_transparent(None, "1 1 1 0.6", 0.5), 0.3),
        (_transparent("A_ZERO", "1 1 1 0.7", 1.0), 0.3),
        (_transparent("RGB_ONE", "0.3 0.3 0.3 1", 1.0), 0.3),
        (_transparent("RGB_ZERO", "0.7 0.7 0.7 1", None), 0.3),
        (_transparent("RGB_ZERO", "1 1 1 1", 0.7), 0.3),
        (_transparent(None, None, 0.3), 0.3),
        # what exporters write for opaque
        (_transparent("A_ONE", "1 1 1 1", 1.0), 1),
        (_transparent("A_ZERO", "0 0 0 0", 1.0), 1),
        (_transparent("RGB_ONE", "1 1 1 1", 1.0), 1),
        (_transparent("RGB_ZERO", "0 0 0 1", 1.0), 1),
        (_transparent("RGB_ZERO", "0 0 0 0", None), 1),
        (_transparent("RGB_ZERO", "1 1 1 1", 0.0), 1),
        (_transparent("A_ONE", "1 1 1 1", 0.0), 1),  # of 3ds Max
        (_transparent(None, None, 0.0), 1),
        (_transparent(None, None, 1.0), 1),
        (_transparent("A_ONE", "nan", None), 1),
        ("", 1),
    ],
)
def test_transparency_is_read_in_every_convention(transparency: str, alpha: float) -> None:
    materials = _materials("<color>1 0 0 1</color>").replace("</lambert>", f"{transparency}</lambert>")
    document = _convert(dae(BOUND, materials=materials))
    material = document.json["materials"][0]
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([1, 0, 0, alpha], abs=0.003)
    assert material.get("alphaMode", "OPAQUE") == ("OPAQUE" if alpha == 1 else "BLEND")
    assert document.warnings == []


def test_transparency_from_a_texture_is_said_to_be_lost() -> None:
    transparent = '<transparent opaque="A_ONE"><texture texture="t" texcoord="UV"/></transparent></lambert>'
    materials = _materials("<color>1 0 0 1</color>").replace("</lambert>", transparent)
    document = _convert(dae(BOUND, materials=materials))
    assert document.json["materials"][0].get("alphaMode", "OPAQUE") == "OPAQUE"
    assert ["transparent" in warning.message for warning in document.warnings] == [True]


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (dae("<node/>"), ErrorCode.NO_FACES),
        (dae('<node><instance_controller url="#skin"/></node>'), ErrorCode.NO_FACES),
        (dae(asset="<up_axis>W_UP</up_axis>"), ErrorCode.MALFORMED_FILE),
        (dae(asset='<unit meter="0"/>'), ErrorCode.MALFORMED_FILE),
        (DAE.replace(b"-1 -1 1", b"-1 nan 1"), ErrorCode.NON_FINITE_POSITIONS),
        (DAE[:-50], ErrorCode.MALFORMED_FILE),
        (zipped({"a.dae": DAE, "b.dae": DAE}), ErrorCode.UNSUPPORTED_FEATURE),
    ],
)
def test_a_scene_that_cannot_be_read_is_refused_for_its_reason(data: bytes, code: ErrorCode) -> None:
    assert _failure(data) is code


def test_instances_that_multiply_without_end_are_refused_before_anything_is_loaded() -> None:
    levels = f'<node id="l0">{USE}</node>' + "".join(
        f'<node id="l{level}">' + f'<instance_node url="#l{level - 1}"/>' * 10 + "</node>" for level in range(1, 12)
    )
    data = dae('<node><instance_node url="#l11"/></node>', extra=f"<library_nodes>{levels}</library_nodes>")
    with pytest.raises(MeshmarkError, match="100,000,000,000 things to draw") as caught:
        admit(data)
    assert caught.value.code is ErrorCode.BUDGET_EXCEEDED


def test_nodes_in_a_circle_are_refused() -> None:
    data = dae('<node id="a"><instance_node url="#a"/></node>')
    with pytest.raises(MeshmarkError, match="circle"):
        admit(data)


def test_triangles_are_counted_whatever_the_file_declares() -> None:
    data = DAE.replace(b'count="12"', b'count="1"')
    with pytest.raises(MeshmarkError, match="12 triangles"):
        Scan(data, Budgets(faces=11))


def test_triangles_are_counted_however_their_numbers_are_broken_into_lines() -> None:
    data = DAE.replace(b"<p>", b"<p>\n").replace(b"</p>", b"\n</p>")
    lines = re.sub(rb"(?s)<p>.*?</p>", lambda found: found[0].replace(b" ", b"\n"), data)
    assert lines.count(b"\n") > data.count(b"\n") + 30
    for also in (lines, lines.replace(b"</p>", b"<extra/><p/></p>")):
        with pytest.raises(MeshmarkError, match="12 triangles"):
            Scan(also, Budgets(faces=11))


def test_a_value_that_is_no_number_is_found_wherever_the_text_is_cut() -> None:
    for blanks in range(2**16 - 40, 2**16):
        with pytest.raises(MeshmarkError) as caught:
            admit(DAE.replace(b"-1 -1 1", b"%*s nan 1" % (blanks, b"1")))
        assert caught.value.code is ErrorCode.NON_FINITE_POSITIONS


GLASS_SKIN = dae(
    _controlled("c"),
    materials=RED.replace("</lambert>", f"{_transparent('RGB_ZERO', '0.7 0.7 0.7 1', 1)}</lambert>"),
    extra=_controllers(("c", "skin", "m"), ("m", "morph", "g")),
)


@settings(max_examples=150)
@given(data=st.data())
def test_a_damaged_scene_is_read_or_refused_but_never_anything_else(data: st.DataObject) -> None:
    damaged = bytearray(data.draw(st.sampled_from([TEXTURED, GLASS_SKIN])))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(damaged)))
        text = st.sampled_from([b"nan", b"1e999", b"-1", b"9" * 20, b"<", b'"', b"\0", b"&lt;", b"#", b"</p>", b""])
        damaged[at : at + data.draw(st.integers(0, 6))] = data.draw(st.one_of(st.binary(max_size=3), text))
    with contextlib.suppress(MeshmarkError):
        flatten(document_of(admit(bytes(damaged))))
