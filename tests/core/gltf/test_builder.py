import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.gltf.accessors import read_accessor
from core.gltf.builder import Builder
from core.gltf.document import COMPONENT_TYPES, ELEMENT_TYPES, Document
from tests.core.gltf.builder import simple


@given(
    code=st.sampled_from(sorted(COMPONENT_TYPES)),
    kind=st.sampled_from(sorted(ELEMENT_TYPES)),
    count=st.integers(1, 5),
    seed=st.integers(0, 9),
    stored=st.booleans(),
)
def test_every_kind_of_attribute_reads_back_as_written(
    code: int, kind: str, count: int, seed: int, stored: bool
) -> None:
    columns, height = ELEMENT_TYPES[kind]
    values = np.random.default_rng(seed).integers(0, 3, (count, columns * height)).astype(COMPONENT_TYPES[code])
    document = simple()
    document.json["accessors"].append({"type": kind} | ({"bufferView": 0} if stored else {}))
    editor = Builder(document)
    added = editor.add_attribute(values, 2, bounded=True)
    editor.json["meshes"][0]["primitives"][0]["attributes"]["_ADDED"] = added
    result = Document.from_glb(editor.to_document().to_glb())
    index = result.json["meshes"][0]["primitives"][0]["attributes"]["_ADDED"]
    assert index == 2, "it takes the number of the one that nothing refers to"
    assert (read_accessor(result, index).reshape(count, -1) == values).all()
    accessor = result.json["accessors"][index]
    assert (accessor["min"], accessor["max"]) == (values.min(axis=0).tolist(), values.max(axis=0).tolist())


def test_what_is_added_but_not_used_is_not_written() -> None:
    document = simple()
    editor = Builder(document)
    editor.add_indices(np.array([0, 1, 2]), np.dtype("u1"))
    assert editor.to_document().to_glb() == document.to_glb()


def test_every_view_starts_at_a_multiple_of_four_and_zeros_lie_between() -> None:
    editor = Builder(simple())
    editor.json["meshes"][0]["primitives"] += [
        editor.json["meshes"][0]["primitives"][0] | {"indices": editor.add_indices(np.full(3, 2), np.dtype("u1"))}
        for _ in range(2)
    ]
    result = Document.from_glb(editor.to_document().to_glb())
    ends = [view["byteOffset"] + view["byteLength"] for view in result.json["bufferViews"]]
    assert [view["byteOffset"] % 4 for view in result.json["bufferViews"]] == [0, 0, 0, 0]
    assert [result.binary[end : end + -end % 4] for end in ends] == [bytes(-end % 4) for end in ends]


def test_rows_that_are_nearly_all_zeros_are_stored_alone_as_they_were() -> None:
    document = simple()
    document.json["accessors"].append({"type": "VEC3", "componentType": 5126, "count": 4})
    for share, sparse in ((1, True), (3, False)):
        editor = Builder(document)
        values = np.zeros((4, 3), "<f4")
        values[:share] = 1
        index = editor.add_attribute(values, 2, bounded=False)
        assert ("sparse" in editor.json["accessors"][index]) == sparse
        editor.json["meshes"][0]["primitives"][0]["attributes"]["_ADDED"] = index
        np.testing.assert_array_equal(read_accessor(editor.to_document(), 2), values)


@pytest.mark.parametrize(
    ("largest", "smallest", "expected"),
    [(254, "u1", "u1"), (255, "u1", "<u2"), (5, "<u2", "<u2"), (65534, "u1", "<u2"), (65535, "<u2", "<u4")],
)
def test_the_index_that_means_restart_is_never_used(largest: int, smallest: str, expected: str) -> None:
    editor = Builder(simple())
    index = editor.add_indices(np.array([[0, 1, largest]]), np.dtype(smallest))
    editor.json["meshes"][0]["primitives"][0]["indices"] = index
    result = Document.from_glb(editor.to_document().to_glb())
    values = read_accessor(result, result.json["meshes"][0]["primitives"][0]["indices"])
    assert (values.tolist(), values.dtype) == ([0, 1, largest], np.dtype(expected))


def test_the_document_being_edited_stays_as_it_is() -> None:
    document = simple()
    before = document.to_glb()
    editor = Builder(document)
    editor.append("materials", {"name": "new"})
    editor.append("accessors", {})
    editor.to_document().to_glb()
    assert document.to_glb() == before
