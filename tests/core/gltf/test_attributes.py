import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.geometry.triangles import unit
from core.gltf.accessors import dequantize
from core.gltf.attributes import Points, encode, interpolate_attribute, orthogonal_tangents
from tests.core.gltf.builder import Builder

VECTORS = arrays(np.float64, (4, 3), elements=st.floats(-10, 10))


@given(dtype=st.sampled_from(["i1", "u1", "<i2", "<u2"]), normalized=st.booleans(), data=st.data())
def test_encoding_undoes_dequantising(dtype: str, normalized: bool, data: st.DataObject) -> None:
    limits = np.iinfo(dtype)
    least = -limits.max if normalized and limits.min else limits.min
    values = np.array([[data.draw(st.integers(least, limits.max))]], dtype)
    fractions = dequantize(values, {"normalized": normalized})
    np.testing.assert_array_equal(encode(fractions, values.dtype, normalized), values)


@pytest.mark.parametrize(("value", "stored"), [(2.0, 255), (-1.0, 0)])
def test_values_out_of_range_saturate(value: float, stored: int) -> None:
    assert encode(np.array([[value]]), np.dtype("u1"), True)[0, 0] == stored


@given(tangents=VECTORS, normals=VECTORS)
def test_tangents_are_unit_and_orthogonal_whatever_comes_in(tangents: np.ndarray, normals: np.ndarray) -> None:
    normals = np.where(np.linalg.norm(normals, axis=1, keepdims=True) > 1e-3, unit(normals), [0, 0, 1])
    result = orthogonal_tangents(tangents, normals)
    np.testing.assert_allclose(np.linalg.norm(result, axis=1), 1, atol=1e-9)
    np.testing.assert_allclose(np.einsum("ni,ni->n", result, normals), 0, atol=1e-9)


def test_colours_are_mixed_and_identifiers_are_picked() -> None:
    builder = Builder()
    color = builder.accessor([[0, 0, 0], [255, 0, 0], [0, 255, 0]], "u1", normalized=True)
    part = builder.accessor([4, 9, 2], "<u2")
    document = builder.document()
    points = Points(np.array([[0, 1, 2]]), np.array([[0.2, 0.6, 0.2]]))
    np.testing.assert_allclose(interpolate_attribute(document, "COLOR_0", color, points), [[0.6, 0.2, 0]])
    np.testing.assert_array_equal(interpolate_attribute(document, "_PART", part, points), [[9]])
