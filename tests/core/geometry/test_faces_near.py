import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry.boxes import Boxes
from core.geometry.faces_near import near
from core.geometry.surface import Surface
from core.placement.candidates import upright
from tests.core.placement.shapes import box, boxes, cuboid, join, moved, plane, sphere, surface


def plainly(shape: Surface, marks: Boxes) -> list[list[int]]:
    corners, outline = shape.positions[shape.faces], marks.corners()
    low, high = corners.min(axis=1), corners.max(axis=1)
    return [
        np.flatnonzero(((low <= one.max(axis=0)) & (high >= one.min(axis=0))).all(axis=1)).tolist() for one in outline
    ]


@pytest.mark.parametrize("shape", [sphere(10, rings=40), cuboid(30, 20, 1), plane(30, 30, cells=50), plane(300, 300)])
def test_it_finds_the_faces_that_a_look_at_every_face_finds(shape: Surface) -> None:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(20, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    marks = Boxes(rng.uniform(-12, 12, (20, 3)), upright(normals), rng.uniform(0.1, 6, (20, 3)))
    assert [faces.tolist() for faces in near(shape, marks)] == plainly(shape, marks)


@settings(max_examples=40)
@given(x=st.floats(-40, 40), y=st.floats(-40, 40), width=st.floats(0.01, 100), cells=st.integers(1, 12))
def test_one_box_anywhere(x: float, y: float, width: float, cells: int) -> None:
    shape, mark = plane(30, 30, cells), box((x, y, 0), (width, 1, 0.5))
    assert near(shape, mark)[0].tolist() == plainly(shape, mark)[0]


def test_a_sliver_across_several_boxes_is_near_each() -> None:
    sliver = plane(30, 0.01)
    marks = boxes(box((-10, 0, 0)), box((0, 0, 0)), box((10, 0, 0)), box((0, 9, 0)))
    assert [len(faces) for faces in near(join(sliver, moved(sliver, shift=(0, 0, 5))), marks)] == [2, 2, 2, 0]


def test_no_boxes_are_near_nothing_and_nothing_is_near_a_surface_without_faces() -> None:
    none = np.empty(0, dtype=np.int64)
    assert near(plane(3, 3), box()[none]) == []
    assert near(surface(np.zeros((1, 3)), np.empty((0, 3), dtype=np.int64)), box())[0].tolist() == []
