import numpy as np
import pytest

from core.analysis.features import FEATURES, FeatureRegions, feature_regions
from core.analysis.saliency import Saliency, saliency
from core.analysis.symmetry import MirrorPlane
from core.analysis.texture import TextureSaliency
from core.arrays import Bool, Float
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from tests.core.placement.shapes import sphere, surface

MIDDLE = MirrorPlane(np.array([1.0, 0.0, 0.0]), 0.0)
BALL = sphere(15)
BALL_SALIENCY = saliency(BALL, 0)


def bumps(*places: tuple[float, float, float]) -> Surface:
    """A ball with small ones that stand half out of it in the directions of some ``places``."""
    ball = sphere(13, 64)
    unit = ball.positions / np.linalg.norm(ball.positions, axis=1, keepdims=True)
    height = np.zeros(len(unit))
    for place in places:
        apart = 13 * np.arccos(np.clip(unit @ (np.array(place) / np.linalg.norm(place)), -1, 1))
        height += np.sqrt(np.clip(1.5**2 - apart**2, 0, None))
    return surface(ball.positions + height[:, None] * unit, ball.faces)


def features(shape: Surface, plane: MirrorPlane | None = MIDDLE) -> FeatureRegions:
    return feature_regions(shape, saliency(shape, 0), None, plane, None)


def near(points: Float, place: tuple[float, float, float], far: float) -> Bool:
    """(N,) points within an angle, in degrees, of a direction."""
    unit = np.array(place) / np.linalg.norm(place)
    return np.asarray(points @ unit >= np.cos(np.radians(far)) * np.linalg.norm(points, axis=1))


def painted(*places: tuple[float, float, float]) -> FeatureRegions:
    """A ball on which small details are painted in some directions."""
    points, normals = BALL_SALIENCY.points, BALL_SALIENCY.normals
    detail = np.zeros(len(points))
    for place in places:
        detail[near(points, place, 5)] = 1.0
    texture = TextureSaliency(points, normals, detail, detail, np.ones((len(points), 3)), 0.5)
    return feature_regions(BALL, BALL_SALIENCY, texture, MIDDLE, None)


def test_a_nose_in_the_middle_of_the_front_is_a_face_with_the_cheeks_round_it() -> None:
    found = features(bumps((0, 0, 1)))
    assert found.face[near(found.points, (0, 0, 1), 6)].all()
    assert not found.face[near(found.points, (0, 0, -1), 60)].any()
    assert not found.face[near(found.points, (1, 0, 0), 30)].any()


def test_a_wart_on_one_side_is_no_feature_and_nor_is_a_pair_far_from_the_middle() -> None:
    for shape in (bumps((0.4, 0, 1)), bumps((1, 0, 0.2), (-1, 0, 0.2))):
        found = features(shape)
        assert not found.face.any()
        assert not found.likely.any()


def test_nothing_is_a_feature_of_what_has_no_left_and_right() -> None:
    found = features(bumps((0, 0, 1)), plane=None)
    assert not found.face.any()
    assert not found.likely.any()


def test_a_head_that_bones_tell_is_a_face_whatever_its_shape() -> None:
    head = BALL_SALIENCY.points[:, 1] > 10
    found = feature_regions(BALL, BALL_SALIENCY, None, None, head)
    assert np.array_equal(found.face, head)


def test_the_face_lies_between_and_round_a_pair_of_painted_eyes() -> None:
    found = painted((0.15, 0.2, 1), (-0.15, 0.2, 1))
    assert found.face[near(found.points, (0, 0.2, 1), 12)].all()
    assert not found.face[near(found.points, (0, 0.2, 1), 40)].all()
    assert not found.face[found.points[:, 2] < 0].any()


@pytest.mark.parametrize("places", [[(0.15, 0.2, 1)], [(0.15, 0.2, 1), (-0.15, -0.3, 1)], [(1, 0, 0.3), (-1, 0, 0.3)]])
def test_one_spot_or_spots_that_are_no_pair_or_far_apart_are_no_eyes(places: list[tuple[float, float, float]]) -> None:
    assert not painted(*places).face.any()


def test_a_fur_that_is_salient_all_over_is_split_until_no_region_is_most_of_it() -> None:
    value = np.where(near(BALL_SALIENCY.points, (0, 0, 1), 8), 0.65, 0.3)
    value += 0.01 * np.sin(np.arange(len(value)))
    fur = Saliency(BALL_SALIENCY.points, BALL_SALIENCY.normals, value, 0.2, BALL_SALIENCY.face)
    found = feature_regions(BALL, fur, None, MIDDLE, None)
    assert found.face[near(found.points, (0, 0, 1), 5)].all()
    assert found.face.mean() < 3 * FEATURES.most


def test_a_box_knows_how_much_of_it_is_on_a_face() -> None:
    points = np.column_stack([np.linspace(-4, 4, 80), np.zeros(80), np.zeros(80)])
    regions = FeatureRegions(points, np.tile([0.0, 0.0, 1.0], (80, 1)), points[:, 0] > 0, points[:, 0] > 10)
    box = Boxes(np.zeros((1, 3)), np.eye(3)[None], np.array([[10.0, 1.0, 1.0]]))
    face, likely = regions.under(regions.pairs_in_boxes(box))
    assert face.tolist() == [0.5]
    assert likely.tolist() == [0.0]
