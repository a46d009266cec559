import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.geometry import bounds
from core.geometry.bounds import meeting
from core.geometry.segments import crossing, distance_to_edges

SEGMENTS = arrays(np.float64, st.tuples(st.integers(0, 8), st.just(2), st.just(2)), elements=st.integers(-6, 6))
POINTS = arrays(np.float64, st.tuples(st.integers(0, 8), st.just(2)), elements=st.integers(-6, 6))


@given(low=POINTS, size=st.integers(0, 3), others=POINTS)
def test_boxes_that_meet_are_paired_once(low: np.ndarray, size: int, others: np.ndarray) -> None:
    found = [pair for pairs in meeting(low, low + size, others, others + 1) for pair in zip(*pairs, strict=True)]
    meets = ((low[:, None] <= others + 1) & (low[:, None] + size >= others)).all(axis=2)
    assert sorted(found) == list(zip(*np.nonzero(meets), strict=True))


def test_pairs_come_in_blocks_of_bounded_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounds, "_BLOCK", 10)
    points = np.zeros((7, 2))
    sizes = [len(one) for one, _ in meeting(points, points, points, points)]
    assert sum(sizes) == 49
    assert max(sizes) <= 14


@given(segments=SEGMENTS, edges=SEGMENTS)
def test_segments_cross_where_each_parts_the_ends_of_the_other(segments: np.ndarray, edges: np.ndarray) -> None:
    def side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> int:
        (ux, uy), (vx, vy) = b - a, c - a
        return int(np.sign(ux * vy - uy * vx))

    expected = [
        any(side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0 for c, d in edges)
        for a, b in segments
    ]
    assert crossing(segments, edges).tolist() == expected


@given(points=POINTS, edges=SEGMENTS, within=st.floats(0.5, 4))
def test_a_distance_is_that_to_the_nearest_segment_or_infinite(
    points: np.ndarray, edges: np.ndarray, within: float
) -> None:
    toward = points.copy()
    found = distance_to_edges(points, edges, within, toward)
    shares = np.linspace(0, 1, 1001)[:, None]
    for point, distance, near in zip(points, found, toward, strict=True):
        true = min((np.linalg.norm(a + shares * (b - a) - point, axis=1).min() for a, b in edges), default=np.inf)
        if np.isfinite(distance):
            assert abs(distance - true) < 0.01
            assert abs(np.linalg.norm(near - point) - distance) < 1e-9
        else:
            assert true > within - 1e-9
