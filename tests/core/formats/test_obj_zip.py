import contextlib
import re
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.gltf.document import Document
from core.gltf.scene import flatten
from tests.core.formats.samples import MTL, OBJ, png, zipped
from tests.validator import error_counts

CUBE = OBJ.replace(b"../../etc/passwd", b"cube.mtl")
BARE = re.sub(rb"mtllib.*\n", b"", OBJ)
RED, BLUE = png(255, 0, 0), png(0, 0, 255)
WEBP = b"RIFF\x1a\0\0\0WEBPVP8L\x0d\0\0\0\x2f\0\0\0\x10\x07\x10\x11\x11\x88\x88\xfe\x07\0"


def _convert(files: dict[str, bytes | str]) -> Document:
    data = zipped(files)
    return document_of(admit(data))


def _materials(document: Document) -> dict[str, dict[str, Any]]:
    """The materials drawn with texture coordinates, or those without if there is no other of the name."""
    found: dict[str, dict[str, Any]] = {}
    for primitive in document.json["meshes"][0]["primitives"]:
        material = document.json["materials"][primitive["material"]]
        if "TEXCOORD_0" in primitive["attributes"] or material["name"] not in found:
            found[material["name"]] = material
    return found


def _texture(document: Document, material: dict[str, Any]) -> bytes:
    texture = document.json["textures"][material["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
    source = texture.get("source", texture.get("extensions", {}).get("EXT_texture_webp", {}).get("source"))
    view = document.json["bufferViews"][document.json["images"][source]["bufferView"]]
    return document.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]


def test_materials_and_textures_of_the_mtl_are_carried() -> None:
    document = _convert({"cube.obj": CUBE, "cube.mtl": MTL, "tex/paint.png": RED})
    materials = _materials(document)
    assert _texture(document, materials["paint"]) == RED
    assert materials["paint"]["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 1]
    gold = materials["gold"]
    assert gold["alphaMode"] == "BLEND"
    assert gold["pbrMetallicRoughness"] == {
        "baseColorFactor": [1, pytest.approx(0.214041), 0, 0.5],
        "metallicFactor": 1,
        "roughnessFactor": 0.25,
    }
    assert document.warnings == []
    assert not error_counts(document.to_glb())


def test_a_texture_is_drawn_only_where_there_are_texture_coordinates() -> None:
    document = _convert({"cube.obj": CUBE, "cube.mtl": MTL, "tex/paint.png": RED})
    for primitive in document.json["meshes"][0]["primitives"]:
        surface = document.json["materials"][primitive["material"]]["pbrMetallicRoughness"]
        assert "baseColorTexture" not in surface or "TEXCOORD_0" in primitive["attributes"]


@pytest.mark.parametrize(
    "path", ["C:\\Users\\me\\paint.png", "/home/me/paint.png", "../../paint.png", "TEX\\Paint.PNG", "tex/paint.png"]
)
def test_a_path_of_another_machine_is_found_by_its_name_in_the_archive(path: str) -> None:
    mtl = f"newmtl paint\nmap_Kd -clamp on -o 0.0 0 {path}\n"
    document = _convert({"m/cube.obj": CUBE, "m/cube.mtl": mtl, "m/tex/paint.png": RED})
    assert _texture(document, _materials(document)["paint"]) == RED


TWO = b"mtllib a.mtl\n" + re.sub(rb"mtllib.*\n", b"", OBJ)


@pytest.mark.parametrize("page", ["cp1251", "cp866", "gb18030", "cp932", "utf-8"])
def test_materials_whose_names_are_in_a_code_page_are_told_apart_and_named(page: str) -> None:
    names = {"gb18030": ("\u6728\u5934", "\u91d1\u5c5e")}.get(
        page, ("\u0414\u0435\u0440\u0435\u0432\u043e", "\u041c\u0435\u0442\u0430\u043b\u043b")
    )
    wood, metal = (name.encode(page) for name in names)
    obj = TWO.replace(b"paint", wood).replace(b"gold", metal)
    mtl = b"newmtl " + wood + b"\nKd 1 0 0\n\nnewmtl " + metal + b"\nKd 0 0 1\n"
    document = _convert({"a.obj": obj, "a.mtl": mtl})
    colors = {
        material["pbrMetallicRoughness"]["baseColorFactor"][0]: name for name, material in _materials(document).items()
    }
    assert set(colors) == {1, 0}
    if page in ("cp1251", "utf-8"):
        assert colors == {1: names[0], 0: names[1]}
    assert document.warnings == []


_NAME = st.binary(min_size=1, max_size=12).filter(
    lambda name: name == name.strip() and not set(name) & set(b"\r\n\0") and not name.endswith(b"\\")
)


@given(first=_NAME, second=_NAME)
def test_names_of_any_bytes_are_the_same_in_both_files_and_no_other(first: bytes, second: bytes) -> None:
    assume(first != second)
    obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl " + first + b"\nf 1 2 3\nusemtl " + second + b"\nf 3 2 1\n"
    mtl = b"newmtl " + first + b"\nKd 1 0 0\nnewmtl " + second + b"\nKd 0 0 1\n"
    document = _convert({"a.obj": obj, "a.mtl": mtl})
    materials = [document.json["materials"][entry["material"]] for entry in document.json["meshes"][0]["primitives"]]
    colors = [material["pbrMetallicRoughness"]["baseColorFactor"][:3] for material in materials]
    assert colors == [[1, 0, 0], [0, 0, 1]]
    assert document.warnings == []


def test_names_in_different_encodings_of_the_same_text_are_the_same() -> None:
    obj = TWO.replace(b"paint", "gr\u00fcn".encode())
    mtl = "newmtl gr\u00fcn\nKd 0 1 0\nnewmtl gold\n".encode("cp1252")
    materials = _materials(_convert({"a.obj": obj, "a.mtl": mtl}))
    assert materials["gr\u00fcn"]["pbrMetallicRoughness"]["baseColorFactor"] == [0, 1, 0, 1]


@pytest.mark.parametrize("page", ["cp1252", "cp850", "mac_roman", "utf-8"])
@pytest.mark.parametrize("name", ["gr\u00fcn #1.png", "gru\u0308n #1.png"])
def test_a_texture_is_found_whatever_code_page_names_it(page: str, name: str) -> None:
    mtl = "newmtl paint\nmap_Kd gr\u00fcn #1.png\n".encode(page)
    document = _convert({"a.obj": TWO, "a.mtl": mtl, name: RED, "other.png": BLUE})
    assert _texture(document, _materials(document)["paint"]) == RED


def test_a_missing_texture_is_named_as_it_is_meant() -> None:
    mtl = "newmtl gold\nnewmtl paint\nmap_Kd gr\u00fcn.png\n".encode("cp1252")
    document = _convert({"a.obj": TWO, "a.mtl": mtl, "x.png": RED})
    assert [warning.message for warning in document.warnings] == ["The texture 'gr\u00fcn.png' is not in the upload."]


def test_materials_that_no_mtl_has_are_said() -> None:
    document = _convert({"a.obj": TWO, "a.mtl": "newmtl Paint\nKd 1 0 0\nnewmtl gold\n"})
    assert "'paint'" in document.warnings[0].message
    assert "gold" not in document.warnings[0].message


@pytest.mark.parametrize("image", [RED, WEBP])
def test_the_only_image_is_the_base_colour_where_there_is_no_mtl(image: bytes) -> None:
    document = _convert({"cube.obj": BARE, "loose.png": image})
    assert _texture(document, _materials(document)["paint"]) == image
    assert document.warnings == []
    assert document.json.get("extensionsRequired", []) == ([] if image is RED else ["EXT_texture_webp"])


def test_the_only_mtl_is_used_even_if_the_obj_names_another() -> None:
    document = _convert({"cube.obj": CUBE, "renamed.mtl": MTL, "tex/paint.png": RED})
    assert _texture(document, _materials(document)["paint"]) == RED
    assert document.warnings == []


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"cube.obj": CUBE, "cube.mtl": MTL}, "paint.png' is not in the upload"),
        ({"cube.obj": CUBE, "cube.mtl": MTL, "tex/paint.png": b"BM not for glTF"}, "is not a PNG"),
        ({"cube.obj": CUBE}, "cube.mtl' are not in the archive"),
        ({"cube.obj": BARE, "a.png": RED, "b.png": BLUE}, "2 images"),
        ({"cube.obj": CUBE, "cube.mtl": "newmtl paint\nmap_Ks s.png\nmap_Bump b.png\n"}, "specular"),
        ({"cube.obj": CUBE, "cube.mtl": "newmtl paint\nmap_Kd -s 2 2 1 a.png\n", "a.png": RED}, "scale and offset"),
        ({"cube.obj": re.sub(rb"/\d*", b"", BARE), "a.png": RED}, "no texture coordinates"),
    ],
)
def test_what_cannot_be_carried_is_said(files: dict[str, bytes | str], said: str) -> None:
    document = _convert(files)
    assert any(said in warning.message for warning in document.warnings), document.warnings
    assert not error_counts(document.to_glb())


def test_a_texture_on_the_network_is_refused() -> None:
    data = zipped({"cube.obj": CUBE, "cube.mtl": "newmtl paint\nmap_Kd http://evil.example/a.png\n"})
    with pytest.raises(MeshmarkError) as caught:
        document_of(admit(data))
    assert caught.value.code is ErrorCode.EXTERNAL_REFERENCE


def test_textures_over_the_budget_are_refused() -> None:
    data = zipped({"cube.obj": BARE, "a.png": png(0, 0, 0, 100)})
    with pytest.raises(MeshmarkError, match="10,000 texture pixels"):
        document_of(admit(data), Budgets(image_pixels=9999))


@settings(max_examples=100)
@given(data=st.data())
def test_a_damaged_mtl_is_read_or_refused_but_never_anything_else(data: st.DataObject) -> None:
    damaged = bytearray(MTL)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged)))
        text = st.sampled_from([b"nan", b"1e999", b"-s", b"-1", b"\n", b"map_d ", b"\0", b"\xff", b"Ns 0\nKs 1"])
        damaged[at : at + data.draw(st.integers(0, 8))] = data.draw(st.one_of(st.binary(max_size=4), text))
    with contextlib.suppress(MeshmarkError):
        flatten(_convert({"cube.obj": CUBE, "cube.mtl": bytes(damaged), "tex/paint.png": RED}))
