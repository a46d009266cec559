import base64
import json
import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from core.budgets import Budgets
from core.errors import Code, ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.gltf.document import Document
from core.gltf.scene import flatten
from core.gltf.textures import read_texture, undecoded_textures
from core.gltf.validate import check_document, check_glb
from tests.core.formats.samples import CUBE_BIN, gltf, png
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder, simple

Change = Callable[[dict[str, Any]], object]


def _code(document: Document, budgets: Budgets | None = None) -> Code:
    with pytest.raises(MeshmarkError) as caught:
        check_glb(document.to_glb(), budgets or Budgets())
    return caught.value.code


def _set(path: str, value: Any) -> Change:
    """Sets ``json["a"][0]["b"]`` for the path ``a.0.b``."""

    def change(entry: Any) -> None:
        *parents, last = (int(part) if part.isdecimal() else part for part in path.split("."))
        for part in parents:
            entry = entry[part]
        entry[last] = value

    return change


def _changed(change: Change) -> Document:
    document = simple(CUBE, CUBE_FACES)
    change(document.json)
    return document


PNG = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">II", 640, 480) + bytes(5)


def _with_image(image: bytes) -> Document:
    builder = Builder()
    primitive = builder.primitive(CUBE, CUBE_FACES)
    view = builder.view(image)
    return builder.document(
        meshes=[{"primitives": [primitive]}], images=[{"bufferView": view, "mimeType": "image/png"}]
    )


def test_a_sound_glb_passes() -> None:
    check_glb(simple(CUBE, CUBE_FACES).to_glb(), Budgets())
    check_glb(_with_image(PNG).to_glb(), Budgets())


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("nodes", {}),
        ("nodes.0", 1),
        ("nodes.0.mesh", 1),
        ("nodes.0.mesh", True),
        ("nodes.0.children", [0]),
        ("nodes.0.children", [7]),
        ("nodes.0.children", 3),
        ("nodes.0.matrix", [1.0] * 15),
        ("nodes.0.translation", ["0", 0, 0]),
        ("nodes.0.rotation", [10**400, 0, 0, 1]),
        ("nodes.0.weights", ["a"]),
        ("nodes.0.skin", 0),
        ("nodes.0.extensions", []),
        ("scene", 5),
        ("scene", "0"),
        ("scenes.0.nodes", [0, 0]),
        ("scenes.0.nodes", [1]),
        ("meshes.0.primitives", None),
        ("meshes.0.primitives.0", []),
        ("meshes.0.primitives.0.mode", 7),
        ("meshes.0.primitives.0.material", 0),
        ("meshes.0.primitives.0.indices", 9),
        ("meshes.0.primitives.0.indices", 0),
        ("meshes.0.primitives.0.attributes", {"POSITION": "0"}),
        ("meshes.0.primitives.0.attributes", {"POSITION": 1}),
        ("meshes.0.primitives.0.attributes", {"POSITION": 0, "NORMAL": 1}),
        ("meshes.0.primitives.0.targets", [{"POSITION": -1}]),
        ("meshes.0.primitives.0.extensions", 1),
        ("accessors.0.componentType", 5124),
        ("accessors.0.componentType", "5126"),
        ("accessors.0.type", "VEC5"),
        ("accessors.0.type", ["VEC3"]),
        ("accessors.0.count", 0),
        ("accessors.0.count", 9),
        ("accessors.0.count", 8.0),
        ("accessors.0.byteOffset", 4),
        ("accessors.0.byteOffset", -4),
        ("accessors.0.bufferView", 2),
        ("accessors.0.normalized", 1),
        ("accessors.0.sparse", {"count": 9}),
        ("accessors.0.sparse", {"count": 1, "indices": {"bufferView": 1, "componentType": 5126}, "values": {}}),
        ("accessors.0.sparse", {"count": 1, "indices": {"bufferView": 5, "componentType": 5123}, "values": {}}),
        ("bufferViews.0.buffer", 1),
        ("bufferViews.0.byteLength", 10**9),
        ("bufferViews.0.byteOffset", None),
        ("bufferViews.0.byteStride", 0),
        ("bufferViews.0.byteStride", 16),
        ("buffers.0.byteLength", "12"),
        ("asset", {}),
        ("extensionsRequired", "KHR_mesh_quantization"),
        ("images", [{}]),
        ("images", [{"bufferView": 9}]),
        ("skins", [{"joints": [4]}]),
        ("extras", json.loads("[" * 70 + "]" * 70)),
    ],
)
def test_a_contradiction_is_refused_as_malformed(path: str, value: Any) -> None:
    assert _code(_changed(_set(path, value))) is ErrorCode.MALFORMED_FILE


def test_nodes_that_are_no_forest_are_refused() -> None:
    circle = [{"mesh": 0}, {"children": [2]}, {"children": [1]}]
    two_parents = [{"children": [2]}, {"children": [2]}, {"mesh": 0}]
    for nodes in (circle, two_parents):
        assert _code(_changed(_set("nodes", nodes))) is ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize(
    ("path", "value", "code"),
    [
        ("buffers.0.byteLength", 10**9, ErrorCode.TRUNCATED_FILE),
        ("buffers.0.uri", "mesh.bin", ErrorCode.EXTERNAL_REFERENCE),
        ("buffers.0.uri", "file:///etc/passwd", ErrorCode.EXTERNAL_REFERENCE),
        ("images", [{"uri": "https://example.org/texture.png"}], ErrorCode.EXTERNAL_REFERENCE),
        ("images", [{"uri": "file:///etc/passwd"}], ErrorCode.EXTERNAL_REFERENCE),
        ("images", [{"uri": "/etc/passwd"}], ErrorCode.EXTERNAL_REFERENCE),
        ("images", [{"uri": "textures/..%2f../secret.png"}], ErrorCode.EXTERNAL_REFERENCE),
        ("images", [{"uri": "//host/share.png"}], ErrorCode.EXTERNAL_REFERENCE),
        ("asset.version", "3.0", ErrorCode.UNSUPPORTED_FORMAT),
        ("asset.minVersion", "2.1", ErrorCode.UNSUPPORTED_FORMAT),
        ("extensionsUsed", True, ErrorCode.MALFORMED_FILE),
        ("extensionsUsed", [["KHR_lights_punctual"]], ErrorCode.MALFORMED_FILE),
        ("animations", [{"samplers": [{"input": {}, "output": 0}]}], ErrorCode.MALFORMED_FILE),
        ("animations", [{"samplers": [{"input": 0, "output": 99}]}], ErrorCode.MALFORMED_FILE),
        ("animations", [{"samplers": 3}], ErrorCode.MALFORMED_FILE),
        ("meshes.0.primitives.0.mode", 1, ErrorCode.NO_FACES),
        ("meshes.0.primitives", [], ErrorCode.NO_FACES),
        ("scenes.0.nodes", [], ErrorCode.NO_FACES),
    ],
)
def test_each_kind_of_refusal_has_its_own_code(path: str, value: Any, code: ErrorCode) -> None:
    assert _code(_changed(_set(path, value))) is code


def test_a_texture_that_lies_beside_the_file_is_carried_unopened() -> None:
    images = [{"uri": "Textures/colour%20map.png"}]
    document = _changed(_set("images", images))
    check_glb(document.to_glb(), Budgets())
    assert Document.from_glb(document.to_glb()).json["images"] == images


def test_a_required_extension_that_is_not_understood_is_named() -> None:
    document = _changed(_set("extensionsRequired", ["KHR_mesh_quantization", "ACME_voxels"]))
    with pytest.raises(MeshmarkError, match="ACME_voxels") as caught:
        check_glb(document.to_glb(), Budgets())
    assert "quantization" not in caught.value.message


@pytest.mark.parametrize(
    "name",
    ["KHR_mesh_quantization", "KHR_texture_transform", "KHR_materials_clearcoat", "EXT_texture_webp", "MSFT_lod"],
)
def test_extensions_that_leave_the_surface_where_it_is_are_let_pass(name: str) -> None:
    check_glb(_changed(_set("extensionsRequired", [name])).to_glb(), Budgets())


def test_every_node_that_draws_a_mesh_counts() -> None:
    document = _changed(_set("nodes", [{"mesh": 0}, {"mesh": 0}, {"mesh": 0}]))
    document.json["scenes"] = [{"nodes": [0, 1]}]
    check_glb(document.to_glb(), Budgets(faces=24, vertices=16))
    assert _code(document, Budgets(faces=23)) is ErrorCode.BUDGET_EXCEEDED
    assert _code(document, Budgets(vertices=15)) is ErrorCode.BUDGET_EXCEEDED


def test_gpu_instances_count() -> None:
    builder = Builder()
    primitive = builder.primitive(CUBE, CUBE_FACES)
    offsets = builder.accessor([[0.0, 0.0, 0.0]] * 10)
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": offsets}}}
    document = builder.document(meshes=[{"primitives": [primitive]}], nodes=[{"mesh": 0, "extensions": extension}])
    check_glb(document.to_glb(), Budgets(faces=120))
    assert _code(document, Budgets(faces=119)) is ErrorCode.BUDGET_EXCEEDED


def test_vertices_that_primitives_share_count_once() -> None:
    document = simple(CUBE, CUBE_FACES)
    document.json["meshes"][0]["primitives"] *= 3
    check_glb(document.to_glb(), Budgets(vertices=8))
    assert _code(document, Budgets(faces=35)) is ErrorCode.BUDGET_EXCEEDED


@pytest.mark.parametrize(("mode", "faces"), [(4, 12), (5, 34), (6, 34)])
def test_strips_and_fans_are_counted_as_the_triangles_they_draw(mode: int, faces: int) -> None:
    document = _changed(_set("meshes.0.primitives.0.mode", mode))
    check_glb(document.to_glb(), Budgets(faces=faces))
    assert _code(document, Budgets(faces=faces - 1)) is ErrorCode.BUDGET_EXCEEDED


def test_values_that_no_bytes_stand_behind_count_against_the_budget() -> None:
    document = simple(CUBE, CUBE_FACES)
    document.json["accessors"] += [{"componentType": 5126, "type": "MAT4", "count": 1_000_000} for _ in range(4)]
    assert _code(document) is ErrorCode.BUDGET_EXCEEDED


def test_one_buffer_view_behind_many_accessors_counts_as_often() -> None:
    document = simple(CUBE, CUBE_FACES)
    document.json["accessors"] *= 100
    assert _code(document, Budgets(bytes=10_000)) is ErrorCode.BUDGET_EXCEEDED


def test_image_pixels_are_read_from_headers_and_counted_together() -> None:
    document = _with_image(PNG)
    document.json["images"].append({"uri": "data:image/png;base64," + base64.b64encode(PNG).decode()})
    check_glb(document.to_glb(), Budgets(image_pixels=2 * 640 * 480))
    assert _code(document, Budgets(image_pixels=2 * 640 * 480 - 1)) is ErrorCode.BUDGET_EXCEEDED
    bomb = _with_image(PNG[:16] + struct.pack(">II", 60_000, 60_000) + bytes(5))
    assert _code(bomb) is ErrorCode.BUDGET_EXCEEDED


def test_json_is_bounded_before_it_is_parsed() -> None:
    document = simple(CUBE, CUBE_FACES)
    document.json["extras"] = {"note": '[[[[{{{ brackets \\" in a text do not count', "list": [[]] * 100}
    check_glb(document.to_glb(), Budgets(json_values=150))
    assert _code(document, Budgets(json_values=100)) is ErrorCode.BUDGET_EXCEEDED
    assert _code(document, Budgets(json_bytes=500)) is ErrorCode.BUDGET_EXCEEDED


def test_bytes_after_the_declared_length_are_ignored() -> None:
    data = simple().to_glb()
    check_glb(data + b"\0\0\0\0", Budgets())
    assert document_of(admit(data + b"\0" * 7)).to_glb() == data


@pytest.mark.parametrize("version", ["2.0", "2.1", 2, 2.0])
def test_the_version_may_be_a_number(version: object) -> None:
    check_document(_changed(_set("asset", {"version": version})), Budgets())


@pytest.mark.parametrize(
    "changes",
    [
        {"asset": {"version": "1.0"}, "buffers": {"a": {}}},
        {"asset": {"version": 1.0}, "meshes": {"a": {}}},
        {"asset": {"version": 1}},
        {"asset": {}, "accessors": {}, "buffers": {}},
        {"asset": {"version": "2.0", "minVersion": "2.1"}},
    ],
)
def test_another_version_is_named_before_anything_that_differs_in_it(changes: dict[str, Any]) -> None:
    json_text = json.dumps(json.loads(gltf()) | changes).encode()
    for data in (json_text, Document(json.loads(json_text), CUBE_BIN).to_glb()):
        with pytest.raises(MeshmarkError, match=r"glTF (1|2\.1)") as caught:
            admit(data)
        assert caught.value.code is ErrorCode.UNSUPPORTED_FORMAT


def _textured(image: bytes, texture: dict[str, Any], **more: Any) -> bytes:
    """A cube with two images, a PNG and ``image``, and one texture."""
    builder = Builder()
    primitive = builder.primitive(CUBE, CUBE_FACES) | {"material": 0}
    images = [{"bufferView": builder.view(data), "mimeType": "image/png"} for data in (png(1, 2, 3), image)]
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    meshes = [{"primitives": [primitive]}]
    return builder.document(meshes=meshes, materials=[material], images=images, textures=[texture], **more).to_glb()


AVIF = b"\0\0\0\x1cftypavif" + bytes(40)


@pytest.mark.parametrize("extension", ["EXT_texture_avif", "MSFT_texture_dds"])
@pytest.mark.parametrize("kind", ["extensionsUsed", "extensionsRequired"])
def test_an_image_of_another_kind_with_a_fallback_is_carried_without_a_word(extension: str, kind: str) -> None:
    texture = {"source": 0, "extensions": {extension: {"source": 1}}}
    data = _textured(AVIF, texture, **{kind: [extension]})
    document = document_of(admit(data))
    assert document.warnings == []
    assert document.to_glb() == data
    assert flatten(document).surface.faces.shape == (12, 3)


@pytest.mark.parametrize("image", [bytes(16), AVIF, b"garbage"])
def test_an_image_that_cannot_be_read_is_carried_and_warned_of_where_it_is_shown(image: bytes) -> None:
    data = _textured(image, {"source": 1})
    document = document_of(admit(data))
    assert document.to_glb() == data
    assert read_texture(document, 0, limit=64) is None
    (warning,) = undecoded_textures(document)
    assert "textures[0]" in warning.message


def test_an_image_of_another_kind_that_is_required_is_refused_by_name() -> None:
    texture = {"extensions": {"EXT_texture_avif": {"source": 1}}}
    with pytest.raises(MeshmarkError, match="requires EXT_texture_avif") as caught:
        admit(_textured(AVIF, texture, extensionsRequired=["EXT_texture_avif"]))
    assert caught.value.code is ErrorCode.UNSUPPORTED_FEATURE


@pytest.mark.parametrize("uri", ["data:image/png;base64,", "data:image/png;base64,!!!", "data:image/png"])
def test_an_embedded_image_that_is_empty_or_damaged_is_carried_and_not_shown(uri: str) -> None:
    buffer = "data:;base64," + base64.b64encode(CUBE_BIN).decode()
    data = gltf(buffer, images=[{"uri": uri}], textures=[{"source": 0}])
    for same in (data, Document(json.loads(data), b"").to_glb()):
        document = document_of(admit(same))
        assert document.json["images"] == [{"uri": uri}]
        assert read_texture(document, 0, limit=64) is None
        assert len(undecoded_textures(document)) == 1


def test_further_chunks_are_carried_with_a_warning_that_names_them() -> None:
    data = replace(simple(), chunks=((b"HAIR", b"1234"),)).to_glb()
    document = document_of(admit(data))
    assert document.to_glb() == data
    assert ["HAIR" in warning.message for warning in document.warnings] == [True]
