import contextlib
import io
import json
import struct
import zipfile
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.budgets import Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.format import Format
from core.gltf.scene import flatten
from tests.core.formats.meshes import MESHES
from tests.core.formats.samples import (
    GLB,
    OBJ,
    OFF,
    PLY_ASCII,
    PLY_STRIPS,
    SAMPLES,
    STL_ASCII,
    STL_BINARY,
    ply_binary,
    zipped,
)
from tests.cost import cost


def _refusal(data: bytes, budgets: Budgets | None = None) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        admit(data, budgets or Budgets())
    error = caught.value
    assert error.message.endswith((".", "?"))
    assert error.remedy.endswith(".")
    return error


def _archive(*names: str) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in names:
            archive.writestr(name, "content")
    return stream.getvalue()


def _glb_of(tree: dict[str, Any]) -> bytes:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack("<I4s", len(text), b"JSON") + text


@pytest.mark.parametrize("name", SAMPLES)
def test_each_format_is_recognised_by_its_content(name: str) -> None:
    assert admit(SAMPLES[name]).format is Format(name.partition("-")[0])


@pytest.mark.parametrize("prefix", [b"\xef\xbb\xbf", b"\n# first a comment\n"])
def test_a_byte_order_mark_or_a_leading_comment_does_not_hide_a_text_format(prefix: bytes) -> None:
    assert admit(prefix + OBJ).format is Format.OBJ
    assert admit(prefix + OFF).format is Format.OFF


def test_an_empty_file_is_refused() -> None:
    assert _refusal(b"").code is ErrorCode.EMPTY_FILE


@pytest.mark.parametrize(
    ("data", "seen"),
    [
        (b"this is just a note, renamed to model.glb\n", "plain text"),
        (b"v for vendetta, f for freedom\n", "plain text"),
        (b"\x89PNG\r\n\x1a\n" + bytes(40), "PNG"),
        (b"\xff\xd8\xff\xe0" + bytes(40), "JPEG"),
        (b"<!DOCTYPE html><html>404</html>", "HTML"),
        (b"%PDF-1.7", "PDF"),
        (b"\x1f\x8b\x08" + bytes(20), "gzip"),
        (b"\x01\x02\x03\x04" * 8, "binary data"),
        (b'{"error": "not found"}', "JSON"),
    ],
)
def test_unknown_content_is_refused_saying_what_it_looks_like(data: bytes, seen: str) -> None:
    error = _refusal(data)
    assert error.code is ErrorCode.UNKNOWN_FORMAT
    assert seen in error.message


@pytest.mark.parametrize(
    ("data", "seen"),
    [
        (_archive("scene.usdc"), "USDZ"),
        (_archive("readme.txt"), "without a model"),
        (_archive("source/Cow.FBX", "textures/cow.png"), "an FBX scene, 'source/Cow.FBX'"),
        (b"\xff\xfe\xff\x0e" + "SketchUp Model".encode("utf-16-le") + bytes(40), "SketchUp"),
        (b"Kaydara FBX Binary  \x00\x1a\x00" + bytes(40), "FBX"),
        (b"PXR-USDC" + bytes(40), "USD"),
        *((kind + b"\1\0\0\0" + bytes(40), kind.decode()) for kind in (b"b3dm", b"i3dm", b"pnts", b"cmpt")),
        (struct.pack("<4sII", b"glTF", 1, 20) + bytes(8), "version 1"),
    ],
)
def test_other_3d_formats_are_refused_by_name_with_a_way_out(data: bytes, seen: str) -> None:
    error = _refusal(data)
    assert error.code is ErrorCode.UNSUPPORTED_FORMAT
    assert seen in error.message
    assert "GLB" in error.remedy


@pytest.mark.parametrize("ending", ["glb", "ply", "3mf", "off", "stl", "obj", "dae", "gltf"])
def test_two_models_of_a_kind_in_one_archive_are_refused_by_name(ending: str) -> None:
    error = _refusal(_archive(f"cow.{ending}", f"pig.{ending.upper()}", "readme.txt"))
    assert error.code is ErrorCode.UNSUPPORTED_FEATURE
    assert f"'cow.{ending}', 'pig.{ending.upper()}'" in error.message


@pytest.mark.parametrize("ending", ["glb", "ply", "3mf", "off", "stl"])
def test_a_model_in_an_archive_that_is_another_thing_is_refused_as_that(ending: str) -> None:
    assert "plain text" in _refusal(_archive(f"cow.{ending}")).message
    other, kind = (OBJ, "obj") if ending != "obj" else (OFF, "off")
    error = _refusal(zipped({f"cow.{ending}": other}))
    assert error.code is ErrorCode.MALFORMED_FILE
    assert f"kind {kind}" in error.message
    assert "empty" in _refusal(zipped({f"cow.{ending}": b""})).message


def test_an_archive_in_an_archive_is_refused_also_as_a_3mf() -> None:
    inner = zipped({"a.obj": OBJ})
    assert "another archive" in _refusal(zipped({"a.obj": OBJ, "b.zip": inner})).message
    assert "obj+zip" in _refusal(zipped({"b.3mf": inner})).message
    assert "3mf+zip" in _refusal(zipped({"b.3mf": SAMPLES["3mf+zip"]})).message


def test_what_a_3mf_in_an_archive_unpacks_to_is_bounded_twice() -> None:
    bomb = zipped({"3D/3dmodel.model": bytes(50 * 2**20)})
    assert len(zipped({"a.3mf": bomb})) < 100_000
    assert _refusal(zipped({"a.3mf": bomb})).code is ErrorCode.BUDGET_EXCEEDED


@pytest.mark.parametrize("data", [OBJ.replace(b"\nf ", b"\nl "), b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"])
def test_an_obj_without_faces_is_refused(data: bytes) -> None:
    assert _refusal(data).code is ErrorCode.NO_FACES


@pytest.mark.parametrize("filling", [b"\n", b"\r", b"\r\n", b"\n  ", b"\nv", b"\n v "])
def test_an_obj_of_nothing_is_looked_through_in_a_few_steps_for_each_megabyte(filling: bytes) -> None:
    data = b"v 0 0 0\n" + filling * (8 * 2**20 // len(filling))
    with cost() as spent:
        assert _refusal(data).code is ErrorCode.NO_FACES
    assert spent.calls < 2000
    assert spent.peak < 32 * 2**20


def test_an_obj_without_vertices_is_refused() -> None:
    assert _refusal(b"o cube\nf 1 2 3\n").code is ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize("header", [bytes(80), b"solid claims".ljust(80), b"exported by somebody".ljust(80, b"\0")])
@pytest.mark.parametrize("body", [b"", bytes(50)])
def test_an_stl_that_claims_four_billion_triangles_is_refused_at_once(header: bytes, body: bytes) -> None:
    error = _refusal(header + struct.pack("<I", 4_000_000_000) + body)
    assert error.code is ErrorCode.TRUNCATED_FILE
    assert "4,000,000,000" in error.message


def test_a_binary_stl_may_start_like_an_ascii_one_and_end_with_stray_bytes() -> None:
    assert STL_BINARY.startswith(b"solid")
    assert admit(STL_BINARY + b"\0\0").format is Format.STL
    assert _refusal(STL_BINARY + bytes(2000)).code is ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize("data", [bytes(84), b"solid nothing\nendsolid nothing\n"])
def test_an_stl_without_triangles_is_refused(data: bytes) -> None:
    assert _refusal(data).code is ErrorCode.NO_FACES


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (PLY_ASCII.replace(b"element vertex 8", b"element vertex 900000000"), ErrorCode.BUDGET_EXCEEDED),
        (PLY_ASCII.replace(b"element face 7", b"element face 4000000"), ErrorCode.TRUNCATED_FILE),
        (ply_binary("<").replace(b"element vertex 8", b"element vertex 14000000"), ErrorCode.TRUNCATED_FILE),
        (PLY_ASCII.replace(b"element face 7", b"element face 0"), ErrorCode.NO_FACES),
        (PLY_ASCII.replace(b"property float z\n", b""), ErrorCode.MALFORMED_FILE),
        (PLY_ASCII.replace(b"vertex_indices", b"something_else"), ErrorCode.MALFORMED_FILE),
        (PLY_ASCII.replace(b"property float x", b"property quaternion x"), ErrorCode.MALFORMED_FILE),
        (PLY_ASCII.replace(b"property float y", b"property float x"), ErrorCode.MALFORMED_FILE),
        (PLY_ASCII.replace(b"format ascii 1.0\n", b""), ErrorCode.MALFORMED_FILE),
        (PLY_ASCII[:60], ErrorCode.TRUNCATED_FILE),
        (OFF.replace(b"8 6 12", b"900000000 6 12"), ErrorCode.BUDGET_EXCEEDED),
        (OFF.replace(b"8 6 12", b"8 4000000 12"), ErrorCode.TRUNCATED_FILE),
        (OFF.replace(b"8 6 12", b"8 0 0"), ErrorCode.NO_FACES),
        (OFF.replace(b"8 6 12", b"eight"), ErrorCode.MALFORMED_FILE),
        (b"OFF BINARY\n" + bytes(20), ErrorCode.NO_FACES),
        (b"OFF BINARY\n" + struct.pack(">3i", 8, 4_000_000, 0), ErrorCode.TRUNCATED_FILE),
        (b"OFF BINARY\n", ErrorCode.TRUNCATED_FILE),
        (PLY_STRIPS.replace(b"tristrips 1", b"tristrips 0"), ErrorCode.NO_FACES),
        (b"4OFF\n1 1 1\n", ErrorCode.UNSUPPORTED_FEATURE),
    ],
)
def test_a_header_that_cannot_be_true_or_exceeds_a_budget_is_refused(data: bytes, code: ErrorCode) -> None:
    assert _refusal(data).code is code


@pytest.mark.parametrize(
    ("data", "budgets", "number"),
    [
        (OBJ, Budgets(faces=7), "8 faces"),
        (OBJ, Budgets(vertices=7), "8 vertices"),
        (STL_ASCII, Budgets(faces=11), "12 triangles"),
        (STL_BINARY, Budgets(faces=11), "12 triangles"),
        (GLB, Budgets(faces=11), "12 triangles"),
        (GLB, Budgets(vertices=7), "8 vertices"),
        (OFF, Budgets(bytes=100), f"{len(OFF)} bytes"),
    ],
)
def test_a_file_over_a_budget_is_refused_naming_its_number(data: bytes, budgets: Budgets, number: str) -> None:
    error = _refusal(data, budgets)
    assert error.code is ErrorCode.BUDGET_EXCEEDED
    assert number in error.message


def _accessor_bomb(**accessor: Any) -> bytes:
    return _glb_of(
        {
            "asset": {"version": "2.0"},
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"componentType": 5126, "type": "VEC3", **accessor}],
        }
    )


@pytest.mark.parametrize(
    "data",
    [
        _accessor_bomb(count=100_000_000),
        _accessor_bomb(count=100_000_000, bufferView=0),
        _accessor_bomb(count=100_000_000, sparse={"count": 1}),
        bytes(80) + struct.pack("<I", 4_000_000_000) + bytes(50),
        PLY_ASCII.replace(b"element vertex 8", b"element vertex 100000000"),
        OFF.replace(b"8 6 12", b"100000000 6 12"),
        GLB[:20] + b"[" * (len(GLB) - 20),
    ],
)
def test_what_a_small_file_declares_costs_neither_time_nor_memory(data: bytes) -> None:
    assert len(data) < 1000
    with cost() as spent, pytest.raises(MeshmarkError):
        admit(data)
    assert spent.calls < 10_000
    assert spent.peak < 2**20


def test_a_small_glb_that_declares_a_hundred_million_vertices_is_over_budget() -> None:
    error = _refusal(_accessor_bomb(count=100_000_000))
    assert error.code is ErrorCode.BUDGET_EXCEEDED
    assert "100,000,000" in error.message


@pytest.mark.parametrize("name", SAMPLES)
@settings(max_examples=60)
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused_but_never_anything_else(name: str, data: st.DataObject) -> None:
    damaged = bytearray(SAMPLES[name])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, max(len(damaged) - 1, 0)))
        length = data.draw(st.integers(0, 8))
        text = st.sampled_from([b"nan", b"1e999", b"-1", b"9" * 20, b"/", b"\n", b"[", b"null", b"\0\0\xc0\x7f", b""])
        damaged[at : at + length] = data.draw(st.one_of(st.binary(max_size=4), text))
    with contextlib.suppress(MeshmarkError):
        flatten(document_of(admit(bytes(damaged))))


@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_cut_short_anywhere_is_read_or_refused_but_never_anything_else(name: str) -> None:
    whole = SAMPLES[name]
    for length in range(0, len(whole), 7):
        try:
            flatten(document_of(admit(whole[:length])))
        except MeshmarkError:
            continue


_ZIPPED = {
    "airplane-textured.zip": Format.OBJ_ZIP,
    "axe-2handed-kaykit.zip": Format.GLTF_ZIP,
    "simple-sparse-accessor.zip": Format.GLTF_ZIP,
    "spot-textured.zip": Format.OBJ_ZIP,
}
_FILES = sorted(path for path in MESHES.glob("*.*") if path.suffix not in (".csv", ".md"))


@pytest.mark.parametrize("path", _FILES, ids=lambda path: path.name)
def test_a_real_file_is_admitted_under_its_true_format(path: Any) -> None:
    assert admit(path.read_bytes()).format is (_ZIPPED.get(path.name) or Format(path.suffix[1:]))
