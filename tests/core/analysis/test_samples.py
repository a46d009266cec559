import numpy as np
import pytest

from core.analysis.samples import SurfaceSamples
from core.geometry.boxes import Boxes
from tests.core.placement.shapes import box, boxes

FRONT, BACK = 0.25, 0.75


def sheet() -> tuple[SurfaceSamples, np.ndarray]:
    """Points one unit apart that face +Z and, 0.1 below, as many that face down; their x, and which side they are."""
    x, y = np.meshgrid(np.arange(-9.5, 10), np.arange(-9.5, 10), indexing="ij")
    top = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    points = np.concatenate([top, top - [0, 0, 0.1]])
    side = np.repeat([FRONT, BACK], x.size)
    return SurfaceSamples(points, np.repeat([[0.0, 0, 1], [0, 0, -1]], x.size, axis=0)), np.column_stack(
        [points[:, 0], side]
    )


def test_several_values_are_averaged_over_what_faces_each_box() -> None:
    samples, values = sheet()
    means = samples.pairs_in_boxes(boxes(box((5, 0, 0), (4, 4, 1)), box((-5, 2, 0), (2, 6, 1)))).mean(values)
    assert means == pytest.approx(np.array([[5, FRONT], [-5, FRONT]]))


def test_a_box_turned_over_sees_the_other_side() -> None:
    samples, values = sheet()
    down = box((-5, 0, -0.1), (4, 4, 1), axes=np.diag([-1.0, 1, -1]))
    assert samples.pairs_in_boxes(down).mean(values)[0] == pytest.approx([-5, BACK])


def test_a_box_smaller_than_the_samples_asks_the_eight_nearest() -> None:
    samples, values = sheet()
    means = samples.pairs_in_boxes(boxes(box((5, 0, 0), (0.2, 0.1, 0.1)), box((-5, 0, 0), (4, 4, 1)))).mean(values)
    assert means == pytest.approx(np.array([[5, FRONT], [-5, FRONT]]))


def test_no_boxes_have_no_means() -> None:
    samples, values = sheet()
    none = Boxes.empty()
    assert samples.pairs_in_boxes(none).mean(values).shape == (0, 2)
