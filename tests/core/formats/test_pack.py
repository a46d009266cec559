import base64
import json
from typing import Any

import pytest

from core.budgets import Budgets
from core.errors import Code, ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.archive import Archive
from core.formats.pack import pack_archive, pack_json
from core.gltf.accessors import read_accessor
from core.gltf.document import Document
from tests.core.formats.samples import CUBE_BIN, GLB, GLTF, gltf, png, zipped
from tests.validator import error_counts

RED, BLUE = png(255, 0, 0), png(0, 0, 255)


def _pack(files: dict[str, bytes | str]) -> Document:
    archive = Archive(zipped(files), Budgets())
    name = archive.only(".gltf")
    return pack_archive(archive.read(name), archive, name, Budgets())


def _image(document: Document, number: int) -> bytes:
    view = document.json["bufferViews"][document.json["images"][number]["bufferView"]]
    return document.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]


def _code(data: bytes) -> Code:
    with pytest.raises(MeshmarkError) as caught:
        admit(data)
    return caught.value.code


@pytest.mark.parametrize("data", [GLTF, zipped({"cube.gltf": gltf(), "cube.bin": CUBE_BIN})])
def test_a_gltf_with_its_buffer_becomes_the_glb_it_could_have_been(data: bytes) -> None:
    document = document_of(admit(data))
    assert document.to_glb() == GLB


def test_images_keep_their_bytes_and_get_their_true_type() -> None:
    images = [{"uri": "tex/a%20b.png"}, {"uri": "blue.jpg", "name": "kept"}, {"uri": "tex/a b.png"}]
    textures = [{"source": 0}, {"source": 1}, {"source": 2}]
    document = _pack(
        {
            "m/x.gltf": gltf(images=images, textures=textures, extras={"kept": [1]}),
            "m/cube.bin": CUBE_BIN,
            "m/tex/a b.png": RED,
            "m/blue.jpg": BLUE,
        }
    )
    assert [_image(document, number) for number in range(3)] == [RED, BLUE, RED]
    assert [image["mimeType"] for image in document.json["images"]] == ["image/png"] * 3
    assert document.json["images"][1]["name"] == "kept"
    assert document.json["extras"] == {"kept": [1]}
    assert document.binary.count(RED) == 1
    assert not error_counts(document.to_glb())


@pytest.mark.parametrize(
    "name", ["wood #2.png", "what?.png", "100%.png", "gr\u00fcn %41.png", "model data.png", "a\\b #.png"]
)
@pytest.mark.parametrize("folder", ["", "tex/"])
def test_files_whose_names_are_written_without_escapes_are_packed(name: str, folder: str) -> None:
    uri = folder + name
    text = gltf(uri + ".bin", images=[{"uri": uri}])
    path = uri.replace("\\", "/")
    document = _pack({"m/x.gltf": text, f"m/{path}": RED, f"m/{path}.bin": CUBE_BIN})
    assert _image(document, 0) == RED
    assert document.warnings == []
    assert "uri" not in json.dumps(document.json)


def test_an_image_at_a_path_of_another_machine_is_found_by_its_name() -> None:
    images = [{"uri": "file:///C:/Users/me/My%20Wood.png"}, {"uri": "C:\\Users\\me\\My Wood.png"}]
    document = _pack({"x.gltf": gltf(images=images), "cube.bin": CUBE_BIN, "tex/My Wood.png": RED})
    assert [_image(document, number) for number in range(2)] == [RED, RED]


def _two_buffers() -> dict[str, Any]:
    """The cube with its positions in one buffer and its indices in another."""
    tree: dict[str, Any] = json.loads(gltf())
    views = tree["bufferViews"]
    tree["buffers"] = [{"uri": f"{number}.bin", "byteLength": view["byteLength"]} for number, view in enumerate(views)]
    for number, view in enumerate(views):
        view["buffer"], view["byteOffset"] = number, 0
    return tree


def test_several_buffers_are_joined_and_their_views_moved() -> None:
    tree = _two_buffers()
    original = Document.from_glb(GLB)
    parts = {
        f"{number}.bin": original.binary[view.get("byteOffset", 0) :][: view["byteLength"]] + b"more"
        for number, view in enumerate(original.json["bufferViews"])
    }
    document = _pack({"x.gltf": json.dumps(tree), **parts})
    assert len(document.json["buffers"]) == 1
    for number in range(len(original.json["accessors"])):
        assert read_accessor(document, number).tolist() == read_accessor(original, number).tolist()
    assert not error_counts(document.to_glb())


def test_extensions_that_name_a_buffer_are_moved_and_fallback_buffers_kept() -> None:
    tree = json.loads(gltf())
    length = tree["buffers"][0]["byteLength"]
    tree["buffers"] = [
        {"byteLength": 64, "extensions": {"EXT_meshopt_compression": {"fallback": True}}},
        {"uri": "a.bin", "byteLength": 4},
        {"uri": "cube.bin", "byteLength": length},
    ]
    for view in tree["bufferViews"]:
        view["buffer"] = 0
        view["extensions"] = {"EXT_meshopt_compression": {"buffer": 2, "byteOffset": 4, "byteLength": 8}}
    document = _pack({"x.gltf": json.dumps(tree), "a.bin": b"1234", "cube.bin": CUBE_BIN})
    assert [buffer["byteLength"] for buffer in document.json["buffers"]] == [8 + length, 64]
    for view in document.json["bufferViews"]:
        assert view["buffer"] == 1
        assert view["extensions"]["EXT_meshopt_compression"] == {"buffer": 0, "byteOffset": 12, "byteLength": 8}


def test_a_missing_texture_stays_a_reference_as_in_a_glb() -> None:
    document = _pack({"x.gltf": gltf(images=[{"uri": "gone.png"}]), "cube.bin": CUBE_BIN})
    assert document.json["images"] == [{"uri": "gone.png"}]


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (gltf(), ErrorCode.EXTERNAL_REFERENCE),
        (zipped({"cube.gltf": gltf()}), ErrorCode.EXTERNAL_REFERENCE),
        (
            zipped({"cube.gltf": gltf("http://evil.example/cube.bin")}),
            ErrorCode.EXTERNAL_REFERENCE,
        ),
        (zipped({"cube.gltf": gltf("file:///etc/passwd")}), ErrorCode.EXTERNAL_REFERENCE),
        (zipped({"cube.gltf": gltf("../cube.bin"), "cube.bin": CUBE_BIN}), ErrorCode.EXTERNAL_REFERENCE),
        (gltf("data:;base64,!!"), ErrorCode.MALFORMED_FILE),
        (zipped({"cube.gltf": gltf(), "cube.bin": CUBE_BIN[:-8]}), ErrorCode.MALFORMED_FILE),
        (zipped({"cube.gltf": "{", "cube.bin": CUBE_BIN}), ErrorCode.MALFORMED_FILE),
        (zipped({"cube.gltf": b"[" * 10**5}), ErrorCode.MALFORMED_FILE),
        (zipped({"a.gltf": gltf(), "b.gltf": gltf(), "cube.bin": CUBE_BIN}), ErrorCode.UNSUPPORTED_FEATURE),
        (GLTF.replace(b'"2.0"', b'"1.0"'), ErrorCode.UNSUPPORTED_FORMAT),
    ],
)
def test_what_cannot_be_packed_is_refused_for_its_reason(data: bytes, code: ErrorCode) -> None:
    assert _code(data) is code


def test_long_data_uris_do_not_count_as_json() -> None:
    payload = CUBE_BIN + bytes(10_000)
    uri = "data:application/octet-stream;base64," + base64.b64encode(payload).decode()
    text = gltf(uri)
    assert len(text) > 10_000
    assert pack_json(text, Budgets(json_bytes=5000)).binary == CUBE_BIN
