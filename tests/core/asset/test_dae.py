import contextlib
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.asset.budgets import Budgets
from core.asset.dae_scan import Scan
from core.asset.flatten import flatten
from core.asset.formats import to_document
from core.asset.gate import admit
from core.asset.gltf import Document
from core.errors import ErrorCode, MeshmarkError
from tests.core.asset.samples import DAE, dae, png, zipped
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
    document = to_document(data, admit(data))
    assert not error_counts(document.to_glb())
    return document


def _failure(data: bytes) -> ErrorCode:
    with pytest.raises(MeshmarkError) as caught:
        to_document(data, admit(data))
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


def _convert_unchecked(data: bytes) -> Document:
    return to_document(data, admit(data))


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
    to_document(data, admit(data))  # everything is imported now
    with mock.patch("builtins.open", side_effect=AssertionError("opened a file")):
        document = to_document(data, admit(data))
    assert [warning.code for warning in document.warnings] == [code]


def test_cameras_lights_and_animations_that_are_not_read_are_said() -> None:
    nodes = f'<node>{USE}</node><node><instance_camera url="#c"/><instance_light url="#l"/></node>'
    animated = dae(nodes).replace(b"</COLLADA>", b"<library_animations><animation/></library_animations></COLLADA>")
    messages = [warning.message for warning in to_document(animated, admit(animated)).warnings]
    assert [message.split(" has ")[1].split(",")[0] for message in messages] == ["animations", "cameras", "lights"]


def test_meshes_that_are_not_read_are_said() -> None:
    document = _convert(dae(f'<node>{USE}<instance_controller url="#skin"/></node>'))
    assert "skinned" in document.warnings[0].message


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


@settings(max_examples=150)
@given(data=st.data())
def test_a_damaged_scene_is_read_or_refused_but_never_anything_else(data: st.DataObject) -> None:
    damaged = bytearray(TEXTURED)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(damaged)))
        text = st.sampled_from([b"nan", b"1e999", b"-1", b"9" * 20, b"<", b'"', b"\0", b"&lt;", b"#", b"</p>", b""])
        damaged[at : at + data.draw(st.integers(0, 6))] = data.draw(st.one_of(st.binary(max_size=3), text))
    with contextlib.suppress(MeshmarkError):
        flatten(to_document(bytes(damaged), admit(bytes(damaged))))
