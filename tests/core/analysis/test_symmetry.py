import numpy as np
import pytest

from core.analysis.symmetry import MirrorPlane, mirror_plane
from core.geometry.sampling import sample
from core.geometry.surface import Surface
from tests.core.placement.shapes import cuboid, join, moved, sphere


def found(shape: Surface) -> MirrorPlane | None:
    points, face = sample(shape, 6000, np.random.default_rng(0))
    return mirror_plane(points, shape.normals[face])


def turned(degrees: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """A rotation about the vertical."""
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])


def figure() -> Surface:
    """A body along z with a head in front and two arms to the sides, about the plane x = 0."""
    arms = (moved(cuboid(5, 2, 2), shift=(side * 7, 2, 5)) for side in (-1, 1))
    return join(cuboid(10, 8, 20), moved(sphere(4), shift=(0, 4, 13)), moved(cuboid(2, 2, 8), shift=(0, 0, -13)), *arms)


@pytest.mark.parametrize("degrees", [0, 33, 100])
def test_a_figure_has_the_plane_between_its_left_and_right_whichever_way_it_looks(degrees: float) -> None:
    plane = found(moved(figure(), turned(degrees)))
    assert plane is not None
    across = turned(degrees) @ np.array([1.0, 0.0, 0.0])
    assert abs(float(plane.normal @ across)) > np.cos(np.radians(2))
    assert abs(plane.offset) < 0.2


def test_a_tool_in_one_hand_does_not_move_the_plane() -> None:
    plane = found(join(figure(), moved(cuboid(1, 7, 1), shift=(9, 5, 5))))
    assert plane is not None
    assert abs(plane.normal[0]) > 0.999
    assert abs(plane.offset) < 0.2


def test_a_heap_of_unlike_things_has_no_plane() -> None:
    heap = [(6, (0, 0, 0)), (3, (9, 2, 1)), (2, (-4, 3, 9)), (4, (5, -6, -8)), (3, (-12, -5, -3))]
    assert found(join(*(moved(sphere(radius), shift=shift) for radius, shift in heap))) is None


def test_images_of_images_are_the_points_themselves() -> None:
    plane = MirrorPlane(np.array([0.6, 0.0, 0.8]), 1.5)
    points = np.random.default_rng(0).normal(size=(20, 3))
    assert plane.side(plane.reflect(points)) == pytest.approx(-plane.side(points))
    assert plane.reflect(plane.reflect(points)) == pytest.approx(points)
