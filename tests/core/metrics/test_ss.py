import numpy as np
import pytest
from numpy.typing import NDArray

from core.metrics.ss import ss

Pictures = NDArray[np.uint8]


class Corner:
    """Features of a picture: its top left pixel. Remembers what it was shown."""

    name = "corner"

    def __init__(self) -> None:
        self.shown: list[Pictures] = []

    def __call__(self, pictures: Pictures) -> NDArray[np.float32]:
        self.shown.append(pictures)
        return pictures[:, 0, 0].astype(np.float32)


def pictures(*corners: tuple[int, int, int]) -> Pictures:
    views = np.zeros((len(corners), 4, 4, 3), np.uint8)
    views[:, 0, 0] = corners
    return views


def test_an_unchanged_asset_scores_exactly_one() -> None:
    views = pictures((1, 2, 3), (7, 0, 9))
    assert ss(views, views.copy(), Corner()) == 1.0


def test_orthogonal_features_score_zero() -> None:
    assert ss(pictures((5, 0, 0)), pictures((0, 9, 0)), Corner()) == 0.0


@pytest.mark.parametrize(
    ("before", "after", "cosine"),
    [((3, 4, 0), (4, 3, 0), 0.96), ((1, 0, 0), (1, 1, 0), 0.5**0.5), ((2, 2, 1), (4, 4, 2), 1)],
)
def test_the_score_of_one_view_is_the_cosine_of_its_features(
    before: tuple[int, int, int], after: tuple[int, int, int], cosine: float
) -> None:
    assert ss(pictures(before), pictures(after), Corner()) == pytest.approx(cosine, abs=1e-12)


def test_the_score_is_the_mean_over_corresponding_views() -> None:
    before = pictures((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1))
    after = pictures((1, 0, 0), (0, 0, 1), (0, 3, 4), (0, 0, 1))
    assert ss(before, after, Corner()) == pytest.approx((1 + 0 + 0.8 + 1) / 4, abs=1e-12)


def test_a_picture_that_occurs_again_is_looked_at_once_and_counts_each_time() -> None:
    corner = Corner()
    before = pictures((1, 0, 0), (0, 1, 0), (1, 0, 0))
    after = pictures((0, 1, 0), (0, 1, 0), (0, 1, 0))
    assert ss(before, after, corner) == pytest.approx(1 / 3)
    assert [len(shown) for shown in corner.shown] == [2]


def test_empty_pictures_are_alike_and_unlike_any_other() -> None:
    nothing = pictures((0, 0, 0), (0, 0, 0))
    assert ss(nothing, nothing, Corner()) == 1.0
    assert ss(nothing, pictures((0, 0, 0), (9, 9, 9)), Corner()) == 0.5
