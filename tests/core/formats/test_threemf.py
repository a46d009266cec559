import contextlib
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.gltf.accessors import read_accessor
from core.gltf.document import Document
from core.gltf.scene import flatten
from tests.core.formats.samples import png, threemf_cube, threemf_model, zipped
from tests.cost import cost
from tests.validator import error_counts

CUBE = f'<object id="1" name="cube">{threemf_cube()}</object>'
ITEM = '<item objectid="1"/>'


def _package(model: str, **more: bytes | str) -> bytes:
    return zipped({"3D/3dmodel.model": model, **more})


def _convert(data: bytes) -> Document:
    document = document_of(admit(data))
    assert not error_counts(document.to_glb())
    return document


def _colors(resources: str, properties: str) -> Document:
    return _convert(_package(threemf_model(f'{resources}<object id="1">{threemf_cube(properties)}</object>', ITEM)))


def _failure(model: str) -> MeshmarkError:
    data = _package(model)
    with pytest.raises(MeshmarkError) as caught:
        document_of(admit(data))
    return caught.value


@pytest.mark.parametrize(("unit", "metres"), [("millimeter", 1e-3), ("inch", 0.0254), ("meter", 1.0), ("micron", 1e-6)])
def test_units_become_metres_and_z_up_becomes_y_up(unit: str, metres: float) -> None:
    item = '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 10"/>'
    surface = flatten(_convert(_package(threemf_model(CUBE, item, f'unit="{unit}"')))).surface
    world = surface.to_world(surface.positions)
    np.testing.assert_allclose(world.mean(axis=0), [0, 10 * metres, 0], atol=1e-6 * metres)
    np.testing.assert_allclose(np.ptp(world, axis=0), 2 * metres, rtol=1e-6)


def test_components_and_items_are_placed_by_all_their_transforms_and_share_one_mesh() -> None:
    pair = (
        '<object id="2" name="pair"><components><component objectid="1" transform="1 0 0 0 1 0 0 0 1 5 0 0"/>'
        '<component objectid="1" transform="0 1 0 -1 0 0 0 0 1 0 0 0"/></components></object>'
    )
    items = '<item objectid="2" transform="2 0 0 0 2 0 0 0 2 0 100 0"/><item objectid="1"/>'
    document = _convert(_package(threemf_model(CUBE + pair, items, 'unit="meter"')))
    assert len(document.json["meshes"]) == 1
    assert [node["name"] for node in document.json["nodes"]] == ["cube", "cube", "cube", "model"]
    surface = flatten(document).surface
    world = surface.to_world(surface.positions)
    centers = [world[surface.faces[surface.face_primitive == number]].mean(axis=(0, 1)) for number in range(3)]
    np.testing.assert_allclose(centers, [[10, 0, -100], [0, 0, -100], [0, 0, 0]], atol=1e-4)


def test_a_transform_that_shears_is_applied_to_the_positions() -> None:
    item = '<item objectid="1" transform="1 0 0 0.5 1 0 0 0 1 0 0 0"/>'
    surface = flatten(_convert(_package(threemf_model(CUBE, item, 'unit="meter"')))).surface
    np.testing.assert_allclose(np.ptp(surface.to_world(surface.positions), axis=0), [3, 2, 2], rtol=1e-6)


@pytest.mark.parametrize("own", ["", 'pid="5" pindex="1"'])
def test_a_model_reads_the_same_however_its_rows_are_written(own: str) -> None:
    group = '<m:colorgroup id="5"><m:color color="#FF0000"/><m:color color="#00FF00"/></m:colorgroup>'
    plain = threemf_model(group + f'<object id="1" {own}>{threemf_cube()}</object>', ITEM)
    others = [
        plain.replace("/>", " />").replace("<vertex", "\n  <vertex"),
        plain.replace("<vertices>", "<vertices><!-- <vertices></vertices> -->"),
        plain.replace("<vertices>", "<vertices >").replace("<triangles>", "<triangles >"),
        re.sub(r'(x="\S+") (y="\S+")', r"\2 \1", plain),
        plain.replace('"', "'"),
    ]
    expected = _convert(_package(plain)).to_glb()
    assert [_convert(_package(other)).to_glb() == expected for other in others] == [True] * len(others)


def test_errors_behind_long_tables_name_their_line() -> None:
    model = threemf_model(CUBE, ITEM).replace("/>", "/>\n")
    broken = model.replace("</build>", "</bild>")
    assert f"line {1 + broken[: broken.index('</bild>')].count(chr(10))}." in _failure(broken).message


def test_objects_that_are_not_built_are_not_drawn() -> None:
    other = f'<object id="7" name="other">{threemf_cube()}</object>'
    document = _convert(_package(threemf_model(CUBE + other, ITEM)))
    assert [mesh["name"] for mesh in document.json["meshes"]] == ["cube"]


def test_colours_of_corners_become_vertex_colours() -> None:
    group = '<m:colorgroup id="5"><m:color color="#FF0000"/><m:color color="#00FF0080"/></m:colorgroup>'
    document = _colors(group, 'pid="5" p1="0" p2="1" p3="0"')
    colored = [one for one in document.json["meshes"][0]["primitives"] if "COLOR_0" in one["attributes"]]
    assert len(colored) == 1
    color = read_accessor(document, colored[0]["attributes"]["COLOR_0"])[read_accessor(document, colored[0]["indices"])]
    assert color.tolist() == [[65535, 0, 0, 65535], [0, 65535, 0, 32896], [65535, 0, 0, 65535]]


def test_base_materials_become_materials_with_their_names() -> None:
    group = '<basematerials id="5"><base name="steel" displaycolor="#808080"/><base name="x"/></basematerials>'
    document = _colors(group, 'pid="5" p1="0"')
    steel = next(material for material in document.json["materials"] if material.get("name") == "steel")
    assert steel["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx([0.215861] * 3 + [1])


def test_a_texture_is_carried_byte_for_byte_with_its_coordinates() -> None:
    image = png(1, 2, 3)
    resources = (
        '<m:texture2d id="8" path="/3D/Textures/a.png" contenttype="image/png"/><m:texture2dgroup id="5" texid="8">'
        '<m:tex2coord u="0" v="0"/><m:tex2coord u="1" v="0.25"/></m:texture2dgroup>'
    )
    properties = 'pid="5" p1="1"'
    body = f'<object id="1">{threemf_cube(properties)}</object>'
    data = zipped({"3D/3dmodel.model": threemf_model(resources + body, ITEM), "3D/Textures/a.png": image})
    document = _convert(data)
    assert document.binary.count(image) == 1
    mapped = [one for one in document.json["meshes"][0]["primitives"] if "TEXCOORD_0" in one["attributes"]]
    assert read_accessor(document, mapped[0]["attributes"]["TEXCOORD_0"]).tolist() == [[1, 0.75]] * 3


def test_parts_in_other_files_of_the_package_are_read() -> None:
    root = threemf_model(
        '<object id="9" name="plate"><components><component p:path="/3D/Objects/a.model" objectid="1"/></components>'
        "</object>",
        '<item objectid="9"/>',
    )
    data = zipped({"3D/3dmodel.model": root, "3D/Objects/a.model": threemf_model(CUBE, "")})
    assert len(flatten(_convert(data)).surface.faces) == 12


@pytest.mark.parametrize(
    "group",
    ['<m:colorgroup id="5"/>', '<m:texture2dgroup id="5" texid="9"/>', '<basematerials id="5"/>'],
    ids=["colours", "texture coordinates", "materials"],
)
def test_colours_of_a_group_without_entries_are_not_in_the_file(group: str) -> None:
    properties = 'pid="5" p1="0"'
    model = threemf_model(group + f'<object id="1">{threemf_cube(properties)}</object>', ITEM)
    document = document_of(admit(zipped({"3D/3dmodel.model": model.encode()})))
    assert "colours that are not in the file" in document.warnings[0].message
    assert list(document.json["meshes"][0]["primitives"][0]["attributes"]) == ["POSITION"]


def test_colours_that_cannot_be_carried_are_said() -> None:
    document = _colors(
        '<m:multiproperties id="5" pids="1"><m:multi pindices="0"/></m:multiproperties>', 'pid="5" p1="0"'
    )
    assert "layered properties" in document.warnings[0].message
    assert "1 triangles" in document.warnings[0].message


def _prusa(*volumes: tuple[int, int, str], key: str = "volume_type") -> str:
    inner = "".join(
        f'<volume firstid="{first}" lastid="{last}"><metadata type="volume" key="name" value="a"/>'
        f'<metadata type="volume" key="{key}" value="{kind}"/></volume>'
        for first, last, kind in volumes
    )
    return f'<?xml version="1.0" encoding="UTF-8"?><config><object id="1" instances_count="1">{inner}</object></config>'


PRUSA = "Metadata/Slic3r_PE_model.config"
BAMBU = "Metadata/model_settings.config"


@pytest.mark.parametrize(
    ("kind", "word"),
    [
        ("NegativeVolume", "1 negative volumes"),
        ("ParameterModifier", "1 modifiers"),
        ("SupportEnforcer", "1 support enforcers"),
        ("SupportBlocker", "1 support blockers"),
    ],
)
def test_volumes_that_are_tools_of_prusa_slicer_are_left_out_and_said(kind: str, word: str) -> None:
    group = '<m:colorgroup id="5"><m:color color="#FF0000"/></m:colorgroup>'
    body = f'<object id="1" pid="5" pindex="0">{threemf_cube()}</object>'
    config = _prusa((0, 7, "ModelPart"), (8, 11, kind))
    document = _convert(zipped({"3D/3dmodel.model": threemf_model(group + body, ITEM), PRUSA: config}))
    whole = flatten(_convert(zipped({"3D/3dmodel.model": threemf_model(group + body, ITEM)}))).surface
    left = flatten(document).surface
    assert len(left.faces) == 8
    np.testing.assert_allclose(
        left.to_world(left.positions[left.faces]), whole.to_world(whole.positions[whole.faces[:8]]), atol=1e-9
    )
    assert "COLOR_0" in document.json["meshes"][0]["primitives"][0]["attributes"]
    assert [word in warning.message for warning in document.warnings] == [True]


def test_modifiers_of_older_projects_are_left_out() -> None:
    model = threemf_model(CUBE, ITEM)
    for value, faces in (("1", 11), ("0", 12)):
        data = zipped({"3D/3dmodel.model": model, PRUSA: _prusa((11, 11, value), key="modifier")})
        assert len(flatten(_convert(data)).surface.faces) == faces


@pytest.mark.parametrize("kind", ["negative_part", "modifier_part", "support_enforcer", "support_blocker"])
def test_parts_that_are_tools_of_bambu_studio_and_orca_are_left_out_and_said(kind: str) -> None:
    components = "".join(
        f'<component p:path="/3D/Objects/a.model" objectid="{number}" transform="1 0 0 0 1 0 0 0 1 {5 * number} 0 0"/>'
        for number in (1, 2)
    )
    root = threemf_model(f'<object id="9"><components>{components}</components></object>', '<item objectid="9"/>')
    bodies = "".join(f'<object id="{number}" name="{number}">{threemf_cube()}</object>' for number in (1, 2))
    parts = f'<part id="1" subtype="normal_part"/><part id="2" subtype="{kind}"/>'
    document = _convert(
        zipped(
            {
                "3D/3dmodel.model": root,
                "3D/Objects/a.model": threemf_model(bodies, ""),
                BAMBU: f'<config><object id="9">{parts}</object><object id="1">{parts}</object></config>',
            }
        )
    )
    assert [mesh["name"] for mesh in document.json["meshes"]] == ["1"]
    assert ["tools for printing" in warning.message for warning in document.warnings] == [True]


@pytest.mark.parametrize("kind", ["support", "solidsupport", "other"])
def test_objects_that_are_no_model_are_left_out_and_said(kind: str) -> None:
    other = f'<object id="7" name="other" type="{kind}">{threemf_cube()}</object>'
    pair = '<object id="8"><components><component objectid="7"/><component objectid="1"/></components></object>'
    document = _convert(_package(threemf_model(CUBE + other + pair, '<item objectid="8"/><item objectid="7"/>')))
    assert [mesh["name"] for mesh in document.json["meshes"]] == ["cube"]
    assert ["2 " in warning.message for warning in document.warnings] == [True]
    error = _failure(threemf_model(other, '<item objectid="7"/>'))
    assert error.code is ErrorCode.NO_FACES
    assert "tools for printing" in error.message


@pytest.mark.parametrize("kind", ["model", "surface", "anything"])
def test_objects_of_all_other_types_are_read(kind: str) -> None:
    document = _convert(_package(threemf_model(CUBE.replace('id="1"', f'id="1" type="{kind}"'), ITEM)))
    assert len(flatten(document).surface.faces) == 12
    assert document.warnings == []


@pytest.mark.parametrize("config", ["<config", "<config><object/><volume firstid='a'/><part subtype=''/></config>"])
def test_settings_of_a_slicer_that_are_damaged_cost_no_model(config: str) -> None:
    document = _convert(zipped({"3D/3dmodel.model": threemf_model(CUBE, ITEM), PRUSA: config}))
    assert len(flatten(document).surface.faces) == 12
    assert len(document.warnings) == (config == "<config")


@pytest.mark.parametrize(
    "painted", ['paint_color="8"', 's:custom_supports="4" xmlns:s="urn:s"', 'p1="0"', 'x="1" y="2"']
)
def test_attributes_that_slicers_paint_on_triangles_are_no_colours(painted: str) -> None:
    document = _colors("", painted)
    assert document.warnings == []
    assert list(document.json["meshes"][0]["primitives"][0]["attributes"]) == ["POSITION"]


@pytest.mark.parametrize(
    ("model", "code"),
    [
        (threemf_model(CUBE, ""), ErrorCode.NO_FACES),
        (threemf_model(CUBE, '<item objectid="2"/>'), ErrorCode.MALFORMED_FILE),
        (threemf_model(CUBE + CUBE, ITEM), ErrorCode.MALFORMED_FILE),
        (threemf_model(CUBE, ITEM, 'unit="parsec"'), ErrorCode.MALFORMED_FILE),
        (threemf_model(CUBE.replace('v1="0"', 'v1="99"'), ITEM), ErrorCode.INDEX_OUT_OF_RANGE),
        (threemf_model(CUBE.replace('x="-1"', 'x="nan"'), ITEM), ErrorCode.NON_FINITE_POSITIONS),
        (threemf_model(CUBE.replace('x="-1"', 'x="left"'), ITEM), ErrorCode.MALFORMED_FILE),
        (threemf_model(CUBE.replace('x="-1"', ""), ITEM), ErrorCode.MALFORMED_FILE),
        (threemf_model(CUBE, '<item objectid="1" transform="1 2 3"/>'), ErrorCode.MALFORMED_FILE),
        (threemf_model(CUBE, ITEM)[:-20], ErrorCode.MALFORMED_FILE),
        (
            threemf_model('<object id="1"><components><component objectid="1"/></components></object>', ITEM),
            ErrorCode.MALFORMED_FILE,
        ),
    ],
)
def test_a_model_that_contradicts_itself_is_refused_for_its_reason(model: str, code: ErrorCode) -> None:
    assert _failure(model).code is code


def test_components_that_multiply_without_end_are_refused_at_once() -> None:
    doubling = "".join(
        f'<object id="{level}"><components>' + f'<component objectid="{level - 1}"/>' * 10 + "</components></object>"
        for level in range(2, 40)
    )
    with cost() as spent:
        error = _failure(threemf_model(CUBE + doubling, '<item objectid="39"/>'))
    assert error.code is ErrorCode.BUDGET_EXCEEDED
    assert spent.calls < 1_000_000


def test_elements_that_are_neither_vertices_nor_triangles_are_bounded_in_all_parts_together() -> None:
    notes = "".join(f"<metadata name='{number}'/>" for number in range(20))
    part = threemf_model(CUBE, ITEM).replace("<resources>", f"{notes}<resources>")
    config = f"<config>{notes}</config>"
    data = _package(part, **{"Metadata/model_settings.config": config, "Metadata/Slic3r_PE_model.config": config})
    elements = 20 + len(("model", "resources", "object", "mesh", "vertices", "triangles", "build", "item"))
    both = elements + 2 * 21
    assert document_of(admit(data), Budgets(xml_elements=both)).warnings == []
    [warning] = document_of(admit(data), Budgets(xml_elements=both - 1)).warnings
    assert f"{both} XML elements" in warning.message
    with pytest.raises(MeshmarkError, match=f"{elements} XML elements"):
        document_of(admit(data), Budgets(xml_elements=elements - 1))
    small = Budgets(vertices=8, faces=12, xml_elements=elements)
    admit(data, small)
    with pytest.raises(MeshmarkError, match=f"{elements + 20} XML elements") as caught:
        admit(data, replace(small, xml_elements=elements - 1))  # where vertices and triangles count alike
    assert caught.value.code is ErrorCode.BUDGET_EXCEEDED


@settings(max_examples=150)
@given(data=st.data())
def test_a_damaged_model_is_read_or_refused_but_never_anything_else(data: st.DataObject) -> None:
    group = '<m:colorgroup id="5"><m:color color="#FF0000"/></m:colorgroup>'
    properties = 'pid="5" p1="0"'
    whole = threemf_model(group + f'<object id="1">{threemf_cube(properties)}</object>', ITEM)
    damaged = bytearray(whole.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(damaged)))
        text = st.sampled_from([b"nan", b"1e999", b"-1", b"9" * 30, b"<", b'"', b"\0", b"&lt;", b"<object id='1'/>"])
        damaged[at : at + data.draw(st.integers(0, 6))] = data.draw(st.one_of(st.binary(max_size=3), text))
    with contextlib.suppress(MeshmarkError):
        archive = zipped({"3D/3dmodel.model": bytes(damaged)})
        flatten(document_of(admit(archive)))
