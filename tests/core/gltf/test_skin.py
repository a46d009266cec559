import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.errors import ErrorCode, MeshmarkError
from core.gltf.skin import blend, merge, quantize_weights, read_influences
from tests.core.gltf.builder import QUAD, Builder


@given(
    influences=st.lists(
        st.lists(st.tuples(st.integers(0, 5), st.floats(0, 1)), min_size=12, max_size=12), min_size=1, max_size=5
    ).filter(lambda rows: all(sum(weight for _, weight in row) > 0.01 for row in rows))
)
def test_merging_adds_up_each_joint_and_keeps_the_strongest_four(influences: list[list[tuple[int, float]]]) -> None:
    joints = np.array([[joint for joint, _ in row] for row in influences])
    weights = np.array([[weight for _, weight in row] for row in influences])

    kept, shares = merge(joints, weights, keep=4)

    np.testing.assert_allclose(shares.sum(axis=1), 1)
    for row in range(len(joints)):
        totals = np.bincount(joints[row], weights[row], minlength=6)
        strongest = np.sort(totals)[::-1][:4]
        np.testing.assert_allclose(shares[row], strongest / strongest.sum(), atol=1e-12)
        used = kept[row][shares[row] > 0]
        assert len(set(used)) == len(used)
        np.testing.assert_allclose(totals[used] / strongest.sum(), shares[row][shares[row] > 0])
        assert (kept[row][shares[row] == 0] == 0).all()


@given(
    weights=st.lists(st.floats(0, 1), min_size=4, max_size=8).filter(lambda row: sum(row) > 0.01),
    dtype=st.sampled_from(["u1", "<u2"]),
)
def test_integer_weights_sum_to_exactly_one(weights: list[float], dtype: str) -> None:
    row = np.array([weights]) / np.sum(weights)
    stored = quantize_weights(row, np.dtype(dtype))
    maximum = int(np.iinfo(dtype).max)
    assert stored.sum(dtype=np.int64) == maximum
    assert np.abs(stored / maximum - row).max() <= 1 / maximum
    assert (stored[row == 0] == 0).all()


def test_the_order_of_the_influences_does_not_change_a_single_bit() -> None:
    rng = np.random.default_rng(1)
    joints, weights = np.array([3, 1, 7, 2]), rng.random(4).astype(np.float32)
    order = np.array([2, 0, 3, 1])
    builder = Builder()
    attributes = {
        "JOINTS_0": builder.accessor([joints, joints[order]], "u1"),
        "WEIGHTS_0": builder.accessor([weights, weights[order]]),
    }
    first, second = blend(*read_influences(builder.document(), attributes), rng.normal(size=(8, 3, 4)))
    np.testing.assert_array_equal(first, second)


def test_a_vertex_without_weights_follows_its_first_joint() -> None:
    builder = Builder()
    attributes = {
        "JOINTS_0": builder.accessor([[2, 0, 0, 0]], "u1"),
        "WEIGHTS_0": builder.accessor([[0, 0, 0, 0]], "u1", normalized=True),
    }
    joints, weights = read_influences(builder.document(), attributes)
    assert joints[weights == 1].tolist() == [2]


def test_a_slot_without_weight_names_no_joint_of_its_own() -> None:
    builder = Builder()
    attributes = {
        "JOINTS_0": builder.accessor([[1, 22, 22, 22]], "u1"),
        "WEIGHTS_0": builder.accessor([[1.0, 0.0, 0.0, 0.0]]),
    }
    joints, weights = read_influences(builder.document(), attributes)
    assert sorted(zip(joints[0].tolist(), weights[0].tolist(), strict=True)) == [(0, 0), (0, 0), (0, 0), (1, 1)]


def test_a_joint_that_the_skin_lacks_is_out_of_range() -> None:
    with pytest.raises(MeshmarkError) as caught:
        blend(np.array([[4]]), np.ones((1, 1)), np.zeros((2, 3, 4)))
    assert caught.value.code is ErrorCode.INDEX_OUT_OF_RANGE


def test_eight_influences_in_two_sets_are_all_read() -> None:
    builder = Builder()
    attributes = {}
    for number in (0, 1):
        attributes[f"JOINTS_{number}"] = builder.accessor([np.arange(4) + 4 * number] * len(QUAD), "<u2")
        attributes[f"WEIGHTS_{number}"] = builder.accessor([[0.125] * 4] * len(QUAD))
    joints, weights = read_influences(builder.document(), attributes)
    assert joints[0].tolist() == list(range(8))
    np.testing.assert_allclose(weights, 0.125)
