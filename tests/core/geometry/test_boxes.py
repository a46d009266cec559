import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from core.geometry.boxes import Boxes, unit_grid


def some_boxes(rng: np.random.Generator, count: int) -> Boxes:
    axes = Rotation.random(count, random_state=int(rng.integers(2**31))).as_matrix()
    return Boxes(rng.uniform(-3, 3, (count, 3)), axes, rng.uniform(0.1, 3, (count, 3)))


@given(st.integers(0, 2**31), st.integers(1, 6), st.integers(1, 80))
def test_a_box_contains_the_points_between_its_faces_and_tells_where(seed: int, count: int, points: int) -> None:
    rng = np.random.default_rng(seed)
    boxes, place = some_boxes(rng, count), rng.uniform(-4, 4, (points, 3))
    box, point, local = boxes.contained(cKDTree(place))
    expected = [
        (number, int(inside))
        for number in range(count)
        for inside in np.flatnonzero((np.abs(boxes.to_local(number, place)) <= boxes.size[number] / 2).all(axis=1))
    ]
    assert list(zip(box.tolist(), point.tolist(), strict=True)) == expected
    back = boxes.center[box] + np.einsum("ni,nij->nj", local, boxes.axes[box])
    np.testing.assert_allclose(back, place[point], atol=1e-12)


def test_no_box_contains_nothing() -> None:
    box, point, local = Boxes.empty().contained(cKDTree(np.zeros((1, 3))))
    assert len(box) == len(point) == len(local) == len(Boxes.empty()) == 0


def test_boxes_of_several_parts_come_one_part_after_another() -> None:
    rng = np.random.default_rng(0)
    one, other = some_boxes(rng, 2), some_boxes(rng, 3)
    both = Boxes.concat(one, Boxes.empty(), other)
    assert len(both) == 5
    assert (both[:2].axes == one.axes).all()
    assert (both[2:].center == other.center).all()
    assert (both[2:].size == other.size).all()


def test_a_box_of_the_world_keeps_its_place_on_the_asset_in_the_frame() -> None:
    world = Boxes(np.array([[3.0, 1, 1]]), np.eye(3)[None], np.array([[2.0, 1, 0.5]]))
    frame = world.to_frame(offset=np.array([1.0, 1, 1]), scale=10.0)
    assert frame.center.tolist() == [[20, 0, 0]]
    assert frame.size.tolist() == [[20, 10, 5]]
    assert (frame.axes == world.axes).all()


def test_a_grid_has_its_corners_on_those_of_the_square() -> None:
    assert unit_grid((2, 3)).tolist() == [[-0.5, -0.5], [-0.5, 0], [-0.5, 0.5], [0.5, -0.5], [0.5, 0], [0.5, 0.5]]
