import base64
import contextlib
import json
import struct
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import Code, ErrorCode, MeshmarkError
from core.gltf.accessors import dequantize, read_accessor
from core.gltf.data_uri import decode_data_uri
from core.gltf.document import COMPONENT_TYPES, ELEMENT_TYPES, Document
from core.gltf.scene import flatten
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder, simple
from tests.validator import error_counts


def _glb(*chunks: tuple[bytes, bytes], magic: bytes = b"glTF", version: int = 2) -> bytes:
    body = b"".join(struct.pack("<I4s", len(payload), kind) + payload for kind, payload in chunks)
    return struct.pack("<4sII", magic, version, 12 + len(body)) + body


def _failure(data: bytes) -> Code:
    with pytest.raises(MeshmarkError) as caught:
        Document.from_glb(data)
    return caught.value.code


def test_a_glb_comes_back_with_its_binary_its_key_order_and_its_unknown_properties() -> None:
    tree = {"zeta": {"unknown": [1, 2.5, None, "\u00e4"]}, "asset": {"version": "2.0"}, "accessors": []}
    data = _glb((b"JSON", json.dumps(tree).encode()), (b"BIN\0", b"12345678"))

    document = Document.from_glb(data)
    again = Document.from_glb(document.to_glb())

    assert json.dumps(again.json) == json.dumps(tree)
    assert again.binary == document.binary == b"12345678"


def test_writing_twice_gives_the_same_aligned_bytes() -> None:
    document = Document({"asset": {"version": "2.0"}, "n": "x"}, b"12345")
    data = document.to_glb()
    assert data == document.to_glb()
    assert len(data) % 4 == 0
    assert struct.unpack_from("<I", data, 8)[0] == len(data)


@pytest.mark.parametrize("has_binary", [True, False])
def test_further_chunks_are_carried_through_in_their_order_and_padded(has_binary: bool) -> None:
    binary = [(b"BIN\0", b"12345678")] if has_binary else []
    data = _glb((b"JSON", b"{}  "), *binary, (b"ABCD", b"one"), (b"ABCD", b""), (b"\1\2\3\4", b"four"))
    document = Document.from_glb(data)
    edited = replace(document, json={"asset": {}}, binary=b"other")
    for again in (Document.from_glb(document.to_glb()), Document.from_glb(edited.to_glb())):
        assert again.chunks == ((b"ABCD", b"one\0"), (b"ABCD", b""), (b"\1\2\3\4", b"four"))
    assert len(document.to_glb()) % 4 == 0
    assert Document.from_glb(edited.to_glb()).binary == b"other\0\0\0"
    assert not error_counts(replace(simple(), chunks=document.chunks).to_glb())


def test_bytes_behind_the_declared_length_are_no_part_of_the_glb() -> None:
    assert Document.from_glb(simple().to_glb() + bytes(4)).to_glb() == simple().to_glb()


@pytest.mark.parametrize("length", range(0, 308, 7))
def test_a_truncated_glb_is_refused_with_its_own_code(length: int) -> None:
    data = simple().to_glb()
    assert length < len(data)
    assert _failure(data[:length]) is ErrorCode.TRUNCATED_FILE


@pytest.mark.parametrize(
    "data",
    [
        _glb((b"JSON", b"{}  "), magic=b"glTX"),
        _glb((b"JSON", b"{}  "), version=1),
        _glb((b"BIN\0", b"1234")),
        _glb((b"JSON", b"{}  "), (b"JSON", b"{}  ")),
        _glb((b"JSON", b"{}  "), (b"BIN\0", b"1234"), (b"BIN\0", b"1234")),
        _glb(),
        _glb((b"JSON", b"{not json")),
        _glb((b"JSON", b"[1, 2]")),
        _glb((b"JSON", b'{"a": NaN}')),
        _glb((b"JSON", b'{"a": 1e999}')),
        _glb((b"JSON", b'{"a": "\xff\xfe"}')),
        _glb((b"JSON", b"[" * 100_000)),
    ],
)
def test_a_file_that_is_not_a_valid_glb_is_malformed(data: bytes) -> None:
    assert _failure(data) is ErrorCode.MALFORMED_FILE


def test_a_chunk_longer_than_the_file_is_truncated() -> None:
    data = bytearray(_glb((b"JSON", b"{}  ")))
    struct.pack_into("<I", data, 12, 1000)
    assert _failure(bytes(data)) is ErrorCode.TRUNCATED_FILE


@given(data=st.binary(max_size=200))
def test_no_bytes_whatsoever_escape_as_another_exception(data: bytes) -> None:
    for candidate in (data, b"glTF\x02\0\0\0" + data, _glb((b"JSON", data))):
        with contextlib.suppress(MeshmarkError):
            Document.from_glb(candidate)


@given(
    code=st.sampled_from(sorted(COMPONENT_TYPES)),
    kind=st.sampled_from(["SCALAR", "VEC2", "VEC3", "VEC4"]),
    count=st.integers(1, 6),
    gap=st.integers(0, 12),
    start=st.integers(0, 9),
)
def test_every_component_type_is_read_at_any_stride(code: int, kind: str, count: int, gap: int, start: int) -> None:
    dtype, width = COMPONENT_TYPES[code], ELEMENT_TYPES[kind][1]
    expected = np.arange(count * width).reshape(count, width).astype(dtype)
    rows = b"".join(row.tobytes() + b"\xee" * gap for row in expected)
    builder = Builder()
    view = builder.view(b"\xdd" * start + rows, byteStride=width * dtype.itemsize + gap)
    accessor = {"bufferView": view, "byteOffset": start, "componentType": code, "count": count, "type": kind}
    builder.json["accessors"].append(accessor)

    values = read_accessor(builder.document(), 0)

    assert values.dtype == dtype
    np.testing.assert_array_equal(values, expected[:, 0] if kind == "SCALAR" else expected)


def test_columns_of_a_byte_matrix_start_at_four_byte_boundaries() -> None:
    builder = Builder()
    view = builder.view(bytes([1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 9, 0]))
    builder.json["accessors"].append({"bufferView": view, "componentType": 5121, "count": 1, "type": "MAT3"})
    np.testing.assert_array_equal(read_accessor(builder.document(), 0), [[1, 2, 3, 4, 5, 6, 7, 8, 9]])


def _sparse(rows: list[int], base: bool) -> Document:
    builder = Builder()
    entry: dict[str, Any] = {"componentType": 5126, "count": 3, "type": "VEC2"}
    if base:
        entry["bufferView"] = builder.view(np.ones((3, 2), "<f4").tobytes())
    entry["sparse"] = {
        "count": len(rows),
        "indices": {"bufferView": builder.view(bytes(rows)), "componentType": 5121},
        "values": {"bufferView": builder.view(np.full((len(rows), 2), 7, "<f4").tobytes())},
    }
    builder.json["accessors"].append(entry)
    return builder.document()


def test_a_sparse_accessor_replaces_its_rows() -> None:
    np.testing.assert_array_equal(read_accessor(_sparse([2], base=True), 0), [[1, 1], [1, 1], [7, 7]])


def test_an_accessor_without_a_buffer_view_is_zero_but_for_its_sparse_rows() -> None:
    np.testing.assert_array_equal(read_accessor(_sparse([0], base=False), 0), [[7, 7], [0, 0], [0, 0]])


def test_a_sparse_row_past_the_end_is_out_of_range() -> None:
    with pytest.raises(MeshmarkError) as caught:
        read_accessor(_sparse([3], base=True), 0)
    assert caught.value.code is ErrorCode.INDEX_OUT_OF_RANGE


@pytest.mark.parametrize(
    "change",
    [
        {"count": 5},
        {"count": 0},
        {"count": 10**12},
        {"byteOffset": 4},
        {"byteOffset": -4},
        {"componentType": 5124},
        {"componentType": [5126]},
        {"type": "VEC5"},
        {"type": {}},
        {"bufferView": 7},
        {"bufferView": "0"},
    ],
)
def test_an_accessor_that_contradicts_its_buffer_is_malformed(change: dict[str, Any]) -> None:
    document = simple()
    document.json["accessors"][0] |= change
    with pytest.raises(MeshmarkError) as caught:
        read_accessor(document, 0)
    assert caught.value.code is ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize(
    ("dtype", "stored", "meant"),
    [
        ("i1", [-128, -127, 0, 127], [-1, -1, 0, 1]),
        ("u1", [0, 51, 255], [0, 0.2, 1]),
        ("<i2", [-32768, 32767], [-1, 1]),
        ("<u2", [0, 13107, 65535], [0, 0.2, 1]),
    ],
)
def test_normalised_integers_become_fractions(dtype: str, stored: list[int], meant: list[float]) -> None:
    values = np.array(stored, dtype)
    np.testing.assert_allclose(dequantize(values, {"normalized": True}), meant)
    np.testing.assert_array_equal(dequantize(values, {}), stored)


@pytest.mark.parametrize("uri", ["data:application/octet-stream;base64,", "data:application/gltf-buffer;base64,"])
def test_a_buffer_in_a_data_uri_is_decoded(uri: str) -> None:
    document = simple()
    document.json["buffers"][0]["uri"] = uri + base64.b64encode(document.binary).decode()
    np.testing.assert_array_equal(
        read_accessor(Document(document.json, b""), 0), [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    )


def test_a_buffer_in_a_data_uri_is_decoded_once_however_many_accessors_are_in_it() -> None:
    document = simple(CUBE, CUBE_FACES)
    document.json["buffers"][0]["uri"] = "data:;base64," + base64.b64encode(document.binary).decode()
    primitive = document.json["meshes"][0]["primitives"][0]
    document.json["meshes"][0]["primitives"] = [primitive] * 400
    with mock.patch("core.gltf.document.decode_data_uri", wraps=decode_data_uri) as decode:
        flatten(document)
    assert decode.call_count == 1


@pytest.mark.parametrize("uri", ["mesh.bin", "../mesh.bin", "http://example.org/mesh.bin", "file:///etc/passwd", 7])
def test_a_buffer_anywhere_else_is_an_external_reference(uri: Any) -> None:
    document = simple()
    document.json["buffers"][0]["uri"] = uri
    with pytest.raises(MeshmarkError) as caught:
        document.buffer(0)
    assert caught.value.code is ErrorCode.EXTERNAL_REFERENCE


@pytest.mark.parametrize("payload", ["data:;base64,@@@", "data:;base64,abcde", "data:nocomma"])
def test_a_broken_data_uri_is_malformed(payload: str) -> None:
    document = simple()
    document.json["buffers"][0]["uri"] = payload
    with pytest.raises(MeshmarkError) as caught:
        document.buffer(0)
    assert caught.value.code is ErrorCode.MALFORMED_FILE


def test_a_second_buffer_without_a_uri_is_malformed() -> None:
    document = simple()
    document.json["buffers"].append({"byteLength": 4})
    with pytest.raises(MeshmarkError) as caught:
        document.buffer(1)
    assert caught.value.code is ErrorCode.MALFORMED_FILE
