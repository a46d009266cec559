import copy
from typing import Any

import pytest

from core.budgets import Budgets
from core.errors import Code, ErrorCode, MeshmarkError
from core.gltf.document import Document
from core.gltf.validate import check_glb
from tests.core.gltf.builder import CUBE, CUBE_FACES, simple
from tests.core.gltf.compressed import MESHOPT, draco, meshopted

DRACO = "KHR_draco_mesh_compression"


def _code(document: Document, budgets: Budgets | None = None) -> Code:
    with pytest.raises(MeshmarkError) as caught:
        check_glb(document.to_glb(), budgets or Budgets())
    return caught.value.code


def _changed(document: Document, path: str, value: Any) -> Document:
    """The document with ``json["a"][0]["b"]`` set for the path ``a 0 b``; a value of ``None`` removes it."""
    json = copy.deepcopy(document.json)
    entry: Any = json
    *parents, last = (int(part) if part.isdecimal() else part for part in path.split())
    for part in parents:
        entry = entry[part]
    if value is None:
        del entry[last]
    else:
        entry[last] = value
    return Document(json, document.binary)


def test_sound_compressed_glbs_pass() -> None:
    for compress in (draco, meshopted):
        check_glb(compress(simple(CUBE, CUBE_FACES)).to_glb(), Budgets(faces=12, vertices=8))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("buffer", 2),
        ("buffer", 1),  # the fallback, which has no bytes
        ("buffer", None),
        ("byteOffset", 10**6),
        ("byteOffset", -4),
        ("byteLength", 10**6),
        ("byteLength", 0),
        ("byteLength", None),
        ("byteStride", 8),
        ("byteStride", 0),
        ("byteStride", 512),
        ("count", 9),
        ("count", 0),
        ("count", 2**40),
        ("count", 8.0),
        ("mode", "TRIANGLES"),
        ("mode", "SEQUENCE"),
        ("mode", None),
        ("filter", "OCTAHEDRAL"),
        ("filter", "QUATERNION"),
        ("filter", 3),
    ],
)
def test_a_meshopt_view_that_contradicts_itself_is_malformed(path: str, value: Any) -> None:
    document = meshopted(simple(CUBE, CUBE_FACES))
    changed = _changed(document, f"bufferViews 0 extensions {MESHOPT} {path}", value)
    assert _code(changed) is ErrorCode.MALFORMED_FILE


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("bufferViews 0 extensions", {MESHOPT: {}}),
        ("bufferViews 0 extensions", {MESHOPT: []}),
        ("bufferViews 0 extensions", []),
        ("bufferViews 0 extensions", {}),  # plain, but over a fallback
        ("bufferViews 0 extensions KHR_meshopt_compression", {}),
        ("bufferViews 0 byteStride", 16),
        ("bufferViews 0 byteLength", 92),
        ("buffers 1 extensions", {}),
        ("buffers 1 extensions", {MESHOPT: 1}),
    ],
)
def test_a_meshopt_glb_that_contradicts_itself_is_malformed(path: str, value: Any) -> None:
    assert _code(_changed(meshopted(simple(CUBE, CUBE_FACES)), path, value)) is ErrorCode.MALFORMED_FILE


def test_a_first_buffer_without_bytes_is_refused_with_a_way_out() -> None:
    document = meshopted(simple(CUBE, CUBE_FACES))
    changed = _changed(document, "buffers 0 extensions", {MESHOPT: {"fallback": True}})
    assert _code(changed) is ErrorCode.UNSUPPORTED_FEATURE


@pytest.mark.parametrize(
    ("path", "value", "code"),
    [
        (f"extensions {DRACO}", [], ErrorCode.MALFORMED_FILE),
        (f"extensions {DRACO} bufferView", 99, ErrorCode.MALFORMED_FILE),
        (f"extensions {DRACO} bufferView", None, ErrorCode.MALFORMED_FILE),
        (f"extensions {DRACO} attributes", {}, ErrorCode.MALFORMED_FILE),
        (f"extensions {DRACO} attributes", {"POSITION": -1}, ErrorCode.MALFORMED_FILE),
        (f"extensions {DRACO} attributes", {"POSITION": "0"}, ErrorCode.MALFORMED_FILE),
        (f"extensions {DRACO} attributes", {"NORMAL": 0}, ErrorCode.MALFORMED_FILE),
        ("indices", None, ErrorCode.MALFORMED_FILE),
        ("mode", 5, ErrorCode.UNSUPPORTED_FEATURE),
    ],
)
def test_a_draco_primitive_that_contradicts_itself_is_refused(path: str, value: Any, code: ErrorCode) -> None:
    changed = _changed(draco(simple(CUBE, CUBE_FACES)), f"meshes 0 primitives 0 {path}", value)
    assert _code(changed) is code


def test_draco_indices_must_be_whole_triangles() -> None:
    document = draco(simple(CUBE, CUBE_FACES))
    indices = document.json["meshes"][0]["primitives"][0]["indices"]
    assert _code(_changed(document, f"accessors {indices} count", 35)) is ErrorCode.MALFORMED_FILE


def test_what_would_be_decoded_counts_against_the_budget() -> None:
    compressed = draco(simple(CUBE, CUBE_FACES))
    assert _code(compressed, Budgets(faces=11)) is ErrorCode.BUDGET_EXCEEDED
    assert _code(compressed, Budgets(bytes=100)) is ErrorCode.BUDGET_EXCEEDED
    assert _code(meshopted(simple(CUBE, CUBE_FACES)), Budgets(bytes=160)) is ErrorCode.BUDGET_EXCEEDED
    huge = meshopted(simple(CUBE, CUBE_FACES))
    view = huge.json["bufferViews"][0]
    view["extensions"][MESHOPT]["count"] = 20_000_000
    view["byteLength"] = huge.json["buffers"][1]["byteLength"] = 12 * 20_000_000
    assert _code(huge) is ErrorCode.BUDGET_EXCEEDED
