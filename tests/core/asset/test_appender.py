import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.asset.appender import Appender
from core.asset.gltf import COMPONENT_TYPES, ELEMENT_TYPES, Document, read_accessor
from tests.core.asset.builder import simple


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
    appender = Appender(simple())
    index = appender.add_attribute(values, {"type": kind} | ({"bufferView": 0} if stored else {}), bounded=True)
    result = Document.from_glb(appender.to_glb())
    assert (read_accessor(result, index).reshape(count, -1) == values).all()
    accessor = result.json["accessors"][index]
    assert (accessor["min"], accessor["max"]) == (values.min(axis=0).tolist(), values.max(axis=0).tolist())


def test_new_data_start_behind_the_old_bytes_at_multiples_of_four() -> None:
    document = simple()
    document.binary += b"xyz"
    appender = Appender(document)
    appender.add_indices(np.array([0, 1, 2]), np.dtype("u1"))
    appender.add_indices(np.array([0, 2, 3]), np.dtype("u1"))
    result = Document.from_glb(appender.to_glb())
    assert result.binary.startswith(document.binary)
    assert [view["byteOffset"] % 4 for view in result.json["bufferViews"][-2:]] == [0, 0]
    assert result.json["buffers"][0]["byteLength"] <= len(result.binary)


@pytest.mark.parametrize(
    ("largest", "smallest", "expected"),
    [(254, "u1", "u1"), (255, "u1", "<u2"), (5, "<u2", "<u2"), (65534, "u1", "<u2"), (65535, "<u2", "<u4")],
)
def test_the_index_that_means_restart_is_never_used(largest: int, smallest: str, expected: str) -> None:
    appender = Appender(simple())
    index = appender.add_indices(np.array([[0, 1, largest]]), np.dtype(smallest))
    values = read_accessor(Document.from_glb(appender.to_glb()), index)
    assert (values.tolist(), values.dtype) == ([0, 1, largest], np.dtype(expected))


def test_the_document_being_extended_stays_as_it_is() -> None:
    document = simple()
    before = document.to_glb()
    appender = Appender(document)
    appender.append("materials", {"name": "new"})
    appender.append("accessors", {})
    appender.to_glb()
    assert document.to_glb() == before
