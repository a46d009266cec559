import contextlib
import copy
import subprocess
import sys
import tracemalloc
from typing import Any

import DracoPy
import meshopt
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit
from core.gltf.accessors import dequantize, read_accessor
from core.gltf.compression import decode_draco, decode_meshopt
from core.gltf.document import Document
from core.gltf.scene import flatten
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder, grid, simple
from tests.core.gltf.compressed import draco, filtered, meshopted
from tests.validator import error_counts


def _rich() -> Document:
    """A grid with normals, UVs, colours and an integer name for each vertex."""
    builder = Builder()
    positions, faces = grid(6)
    count = len(positions)
    random = np.random.default_rng(1)
    return builder.document(
        meshes=[
            {
                "primitives": [
                    builder.primitive(
                        positions,
                        faces,
                        NORMAL=builder.accessor(np.tile([[0, 0, 1]], (count, 1))),
                        TEXCOORD_0=builder.accessor(random.random((count, 2))),
                        COLOR_0=builder.accessor(random.integers(0, 256, (count, 4)), "u1", normalized=True),
                        _ID=builder.accessor(np.arange(count), "<f4"),
                    )
                ]
            }
        ]
    )


def _corners(document: Document) -> NDArray[np.float64]:
    """(T, 3, n) every attribute of every corner, triangles sorted and each turned to its smallest corner."""
    (primitive,) = document.json["meshes"][0]["primitives"]
    columns = [
        dequantize(read_accessor(document, accessor), document.json["accessors"][accessor]).reshape(-1, width)
        for (_, accessor), width in zip(sorted(primitive["attributes"].items()), (4, 3, 3, 2, 1), strict=True)
    ]
    rows = np.round(np.hstack(columns), 5)
    corners = rows[read_accessor(document, primitive["indices"])].reshape(-1, 3, rows.shape[1])
    first = corners[:, :, -1].argmin(axis=1)  # the name, unique to a vertex
    turned = corners[np.arange(len(corners))[:, None], (first[:, None] + np.arange(3)) % 3]
    return np.asarray(turned[np.lexsort(turned[:, :, -1].T)])


@pytest.mark.parametrize("metadata", [False, True])
@pytest.mark.parametrize("preserve_order", [False, True])
def test_a_draco_primitive_has_the_triangles_and_attributes_that_went_in(preserve_order: bool, metadata: bool) -> None:
    plain = _rich()
    compressed = draco(plain, preserve_order=preserve_order, metadata=metadata)
    admit(compressed.to_glb())
    assert not error_counts(compressed.to_glb())
    np.testing.assert_allclose(_corners(compressed), _corners(plain), atol=2e-5)


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize("mode", ["TRIANGLES", "INDICES"])
def test_a_meshopt_asset_has_the_triangles_and_attributes_that_went_in(mode: str, version: int, name: str) -> None:
    plain = _rich()
    compressed = meshopted(plain, mode=mode, version=version, name=name)
    admit(compressed.to_glb())
    np.testing.assert_array_equal(_corners(compressed), _corners(plain))
    if mode == "INDICES":
        for accessor in range(len(plain.json["accessors"])):
            np.testing.assert_array_equal(read_accessor(compressed, accessor), read_accessor(plain, accessor))


def _directions(width: int) -> NDArray[np.float64]:
    vectors = np.random.default_rng(2).normal(size=(40, width))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def test_octahedral_normals_point_where_they_did() -> None:
    directions = np.hstack([_directions(3), np.ones((40, 1))])
    for stride, dtype, bits, off in ((4, "i1", 8, 2e-2), (8, "<i2", 12, 1e-3)):
        rows = meshopt.encode_filter_oct(directions, stride, bits)
        document = filtered(rows, dtype, True, "OCTAHEDRAL")
        values = dequantize(read_accessor(document, 0), {"normalized": True})
        np.testing.assert_allclose(values, directions, atol=off)


def test_quaternions_turn_as_they_did() -> None:
    turns = _directions(4)
    document = filtered(meshopt.encode_filter_quat(turns, 8, 16), "<i2", True, "QUATERNION")
    values = dequantize(read_accessor(document, 0), {"normalized": True})
    np.testing.assert_allclose(np.abs((values * turns).sum(axis=1)), 1, atol=1e-3)


def test_exponential_floats_keep_their_digits() -> None:
    numbers = np.random.default_rng(3).normal(size=(40, 3)) * [1e-3, 1, 1e3]
    document = filtered(meshopt.encode_filter_exp(numbers, 20, "Separate"), "<f4", False, "EXPONENTIAL")
    np.testing.assert_allclose(read_accessor(document, 0), numbers, rtol=1e-4)


def test_colors_of_the_newer_extension_are_read() -> None:
    colors = np.random.default_rng(4).random((40, 4))
    document = filtered(meshopt.encode_filter_color(colors, 8, 12), "<u2", True, "COLOR")
    values = dequantize(read_accessor(document, 0), {"normalized": True})
    np.testing.assert_allclose(values, colors, atol=5e-3)


def _malformed(document: Document) -> str:
    with pytest.raises(MeshmarkError) as caught:
        flatten(document)
    assert caught.value.code is ErrorCode.MALFORMED_FILE
    return caught.value.message


def test_a_draco_stream_that_is_cut_short_or_random_is_refused() -> None:
    document = draco(simple(CUBE, CUBE_FACES))
    view = document.json["bufferViews"][-1]
    for bytes_left in range(0, view["byteLength"], 9):
        cut = copy.deepcopy(document)
        cut.json["bufferViews"][-1]["byteLength"] = bytes_left
        assert "Draco" in _malformed(cut)
    start = view["byteOffset"]
    noise = np.random.default_rng(5).bytes(view["byteLength"])
    assert "Draco" in _malformed(Document(document.json, document.binary[:start] + noise))


@settings(max_examples=150)
@given(data=st.data())
def test_damaged_compressed_bytes_are_decoded_or_refused_but_never_anything_else(data: st.DataObject) -> None:
    compressed = data.draw(st.sampled_from(_COMPRESSED))
    start = len(simple(CUBE, CUBE_FACES).binary)
    damaged = bytearray(compressed.binary)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(start, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(MeshmarkError):
        flatten(Document(copy.deepcopy(compressed.json), bytes(damaged)))


_COMPRESSED = [
    draco(simple(CUBE, CUBE_FACES)),
    draco(simple(CUBE, CUBE_FACES), preserve_order=False, metadata=True),
    meshopted(simple(CUBE, CUBE_FACES)),
    meshopted(simple(CUBE, CUBE_FACES), mode="INDICES", version=1),
]


@pytest.mark.parametrize("metadata", [False, True])
@pytest.mark.parametrize("preserve_order", [False, True])
def test_a_draco_stream_of_more_triangles_than_declared_is_not_decoded(preserve_order: bool, metadata: bool) -> None:
    positions, faces = grid(300)
    stream = DracoPy.encode(
        positions.astype(np.float64),
        faces,
        preserve_order=preserve_order,
        create_metadata=metadata,
        compression_level=10,
        generic_attributes={"a name": positions} if metadata else None,
    )
    tracemalloc.start()
    try:
        with pytest.raises(MeshmarkError, match="180,000 triangles") as caught:
            decode_draco(stream, 12, "A stream")
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()
    assert caught.value.code is ErrorCode.MALFORMED_FILE
    assert len(decode_draco(stream, len(faces), "A stream")[0]) == 3 * len(faces)


@pytest.mark.parametrize("head", [b"", b"DRACO", b"DRACO\2\1\1\1\0\0", b"glTF" * 9])
def test_only_the_draco_version_of_gltf_is_read(head: bytes) -> None:
    with pytest.raises(MeshmarkError, match=r"2\.2") as caught:
        decode_draco(head + bytes(20), 12, "A stream")
    assert caught.value.code is ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize("rest", [b"", b"\xff" * 40, b"\x80" * 40, b"\x00" + b"\x00\x01\x00" * 20_000, b"\x7f\x00" * 3])
@pytest.mark.parametrize("flags", [b"\0\0", b"\0\x80"])
def test_a_draco_head_that_leads_nowhere_is_refused(flags: bytes, rest: bytes) -> None:
    for method in (b"\0", b"\1"):
        with pytest.raises(MeshmarkError) as caught:
            decode_draco(b"DRACO\2\2\1" + method + flags + rest, 12, "A stream")
        assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_a_draco_stream_must_hold_what_its_accessors_declare() -> None:
    document = draco(simple(CUBE, CUBE_FACES))
    primitive = document.json["meshes"][0]["primitives"][0]
    position, indices = primitive["attributes"]["POSITION"], primitive["indices"]
    for entry, change in (
        (document.json["accessors"][position], {"count": 9}),
        (document.json["accessors"][position], {"type": "VEC2"}),
        (document.json["accessors"][position], {"componentType": 5121}),
        (document.json["accessors"][indices], {"count": 33}),
        (document.json["bufferViews"][-1], {"byteLength": 10}),
        (primitive["extensions"]["KHR_draco_mesh_compression"], {"attributes": {"POSITION": 77}}),
    ):
        before = copy.deepcopy(entry)
        entry |= change
        _malformed(Document(copy.deepcopy(document.json), document.binary))
        entry |= before


def test_two_streams_cannot_stand_behind_one_accessor() -> None:
    document = draco(simple(CUBE, CUBE_FACES))
    second = copy.deepcopy(document.json["meshes"][0]["primitives"][0])
    document.json["bufferViews"].append(dict(document.json["bufferViews"][-1]))
    second["extensions"]["KHR_draco_mesh_compression"]["bufferView"] += 1
    document.json["meshes"][0]["primitives"].append(second)
    assert "two different" in _malformed(document)


def test_plain_bytes_beside_a_draco_stream_are_taken() -> None:
    plain = simple(CUBE, CUBE_FACES)
    document = draco(plain)
    document.json["accessors"] = copy.deepcopy(plain.json["accessors"])
    surface = flatten(document).surface
    np.testing.assert_array_equal(surface.faces, flatten(plain).surface.faces)


@pytest.mark.parametrize(
    "change", [{"count": 400}, {"byteStride": 16}, {"mode": "TRIANGLES"}, {"mode": 3}, {"count": None}]
)
def test_meshopt_bytes_must_be_what_they_are_declared_to_be(change: dict[str, Any]) -> None:
    rows = np.arange(96, dtype=np.uint8).reshape(8, 12)
    data = meshopt.encode_gltf_buffer(rows, "ATTRIBUTES")
    declared = {"count": 8, "byteStride": 12, "mode": "ATTRIBUTES"}
    assert decode_meshopt(data, declared, "A view") == rows.tobytes()
    with pytest.raises(MeshmarkError) as caught:
        decode_meshopt(data, declared | change, "A view")
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_looking_at_headers_loads_no_decoder() -> None:
    program = (
        "import sys; from core.formats.admission import admit; admit(sys.stdin.buffer.read());"
        "print(*({'DracoPy', 'meshopt'} & sys.modules.keys()))"
    )
    for document in _COMPRESSED[1:3]:
        result = subprocess.run(
            [sys.executable, "-c", program], input=document.to_glb(), capture_output=True, check=True
        )
        assert result.stdout.strip() == b""
