import numpy as np
import pytest

from core.artwork.outline import text_artwork
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.lab.baselines.solid import solid
from core.lab.baselines.whole_boolean import fuse_curved, fuse_flat, text_solid
from core.lab.plain import Mesh
from core.metrics.topology import topology
from tests.core.lab.baselines.assets import watertight
from tests.core.placement.shapes import box as mark
from tests.core.placement.shapes import rotation
from tests.core.shapes import box, sphere

TEXT = text_artwork("mark")
BALL = sphere(15, 5)
ON_BALL = mark((0, 0, 15), (4, 4 * TEXT.aspect, 0.5))


def curved(shape: Surface, boxes: Boxes, relief: float) -> Mesh:
    return fuse_curved(solid(shape), TEXT, boxes, shape, SpatialIndex(shape.positions, shape.faces), relief)


def standing_out(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Height above the plane through the top of the ball, and distance to the ball, of vertices off the ball."""
    distance, _, _ = SpatialIndex(BALL.positions, BALL.faces).closest(mesh.positions)
    off = distance > 1e-3
    return mesh.positions[off, 2] - 15, distance[off]


def test_flat_text_has_a_plane_top_on_a_ball() -> None:
    height, distance = standing_out(fuse_flat(solid(BALL), TEXT, ON_BALL))
    assert height == pytest.approx(0.25)
    assert np.ptp(distance) > 0.05


def test_curve_matched_text_has_its_top_at_a_constant_distance_on_a_ball() -> None:
    height, distance = standing_out(curved(BALL, ON_BALL, 0.2))
    assert distance == pytest.approx(0.2, rel=0.02)
    assert np.ptp(height) > 0.05


@pytest.mark.parametrize("relief", [0.05, 0.8])
def test_letters_of_any_height_are_fused_into_the_asset(relief: float) -> None:
    mesh = curved(BALL, ON_BALL, relief)
    assert watertight(mesh)
    assert topology(mesh.surface()).components == 1


def test_flat_text_is_fused_into_the_asset() -> None:
    mesh = fuse_flat(solid(BALL), TEXT, ON_BALL)
    assert watertight(mesh)
    assert topology(mesh.surface()).components == 1


def test_the_back_of_a_thin_plate_stays_flat() -> None:
    plate = box(30, 20, 0.2)
    mesh = curved(plate, mark((0, 0, 0.1), (4, 4 * TEXT.aspect, 0.5)), 0.2)
    assert mesh.positions[:, 2].min() == pytest.approx(-0.1)
    assert mesh.positions[:, 2].max() == pytest.approx(0.3)


def test_letters_that_do_not_meet_the_asset_are_lost_by_curve_matching_and_float_without() -> None:
    away = mark((0, 0, 17), (4, 4 * TEXT.aspect, 0.5))
    assert topology(curved(BALL, away, 0.2).surface()).components == 1
    assert topology(fuse_flat(solid(BALL), TEXT, away).surface()).components == 1 + len(TEXT.label)


def test_text_fills_its_box_wherever_that_is() -> None:
    turned = mark((1, 2, 3), (4, 4 * TEXT.aspect, 0.5), rotation((1, 2, 3), 50))
    local = turned.to_local(0, np.asarray(text_solid(TEXT, turned, 0).to_mesh64().vert_properties))
    assert local.min(axis=0) == pytest.approx(-turned.size[0] / 2)
    assert local.max(axis=0) == pytest.approx(turned.size[0] / 2)
