"""The ground of small scenes as a viewer draws them."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from core.analysis.analyse import analyse
from core.geometry.spatial import Eye
from core.gltf.scene import Scene, scene_of
from tests.core.rendering.glb import CORNERS, CUBE_FACES, GlbWriter, plain

INWARDS = CUBE_FACES[:, ::-1]
GLASS = plain((1, 1, 1, 0.2), alphaMode="BLEND")
UP = np.array([[0.0, 0.0, 1.0]])


def _scene(*parts: tuple[ArrayLike, ArrayLike, dict[str, Any]], **node: Any) -> Scene:
    """Meshes of (positions, faces, material), each under a node of its own."""
    writer = GlbWriter()
    for positions, faces, material in parts:
        writer.mesh(positions, faces, material=material, **node)
    return scene_of(writer.bytes())


def test_a_room_is_looked_into_through_the_backs_of_its_walls() -> None:
    ground = analyse(_scene((CORNERS, INWARDS, {}), (CORNERS / 4, CUBE_FACES, {})))
    assert not ground.flipped.any()
    above_the_table, on_the_floor = np.array([[0.0, 0, 4.0]]), np.array([[9.0, 9.0, -14.9]])
    assert ground.index.first_hit(above_the_table, UP, Eye.FAR)[1][0] == -1
    assert ground.index.first_hit(on_the_floor, UP, Eye.FAR)[1][0] == -1
    assert ground.index.first_hit(np.array([[9.0, 9.0, 20.0]]), -UP, Eye.ORIGIN)[0][0] == pytest.approx(35.0)


def test_double_sided_walls_are_in_the_way_and_are_turned_outwards() -> None:
    ground = analyse(_scene((CORNERS, INWARDS, {"doubleSided": True}), (CORNERS / 4, CUBE_FACES, {})))
    assert ground.flipped.tolist() == [True] * 12 + [False] * 12
    assert ground.index.first_hit(np.array([[0.0, 0, 4.0]]), UP, Eye.FAR)[1][0] >= 0


def test_a_mirrored_node_does_not_turn_what_a_viewer_draws() -> None:
    mirrored = analyse(_scene((CORNERS, CUBE_FACES, {}), scale=[-1, 1, 1]))
    assert not mirrored.flipped.any()
    outwards = (mirrored.surface.normals * mirrored.surface.positions[mirrored.surface.faces].mean(axis=1)).sum(axis=1)
    assert (outwards > 0).all()


def test_a_toon_hull_hides_nothing_of_the_body_in_it() -> None:
    ground = analyse(_scene((CORNERS, INWARDS, {}), (CORNERS * 0.98, CUBE_FACES, {})))
    on_the_body = np.array([[0.3, 0.2, 14.75]])
    assert ground.index.first_hit(on_the_body, UP, Eye.FAR)[1][0] == -1


def test_what_stands_in_glass_is_looked_at_through_it_but_it_is_still_there_to_stand_on() -> None:
    ground = analyse(_scene((CORNERS, CUBE_FACES, GLASS), (CORNERS / 4, CUBE_FACES, {})))
    assert ground.opaque.tolist() == [False] * 12 + [True] * 12
    assert ground.cuttable.all()
    inside = np.array([[0.0, 0, 4.0]])
    assert ground.index.first_hit(inside, UP, Eye.FAR)[1][0] == -1
    assert ground.glazed.first_hit(inside, UP, Eye.FAR)[1][0] >= 0


def test_of_two_coats_the_one_that_looks_out_is_the_ground() -> None:
    for order in ((CUBE_FACES, INWARDS), (INWARDS, CUBE_FACES)):
        ground = analyse(_scene((CORNERS, np.concatenate(order), {})))
        outwards = (ground.surface.normals * ground.surface.positions[ground.surface.faces].mean(axis=1)).sum(axis=1)
        assert (outwards[ground.opaque] > 0).all()
        assert ground.opaque.sum() == 12
        assert not ground.flipped.any()


def test_a_box_that_nobody_sees_hides_nothing_and_carries_nothing() -> None:
    collider = plain((1, 1, 1, 0), alphaMode="BLEND")
    ground = analyse(_scene((CORNERS / 2, CUBE_FACES, {}), (CORNERS, CUBE_FACES, collider)))
    assert ground.cuttable.tolist() == [True] * 12 + [False] * 12
    assert ground.surface.scale == 30  # of the cube of side 1
    assert ground.glazed.first_hit(np.array([[0.0, 0, 15.1]]), UP)[1][0] == -1


def test_one_part_in_odd_coordinates_is_coarse_alone() -> None:
    writer = GlbWriter().mesh(CORNERS, CUBE_FACES).mesh(CORNERS + 17000, CUBE_FACES, translation=[-17000.0] * 3)
    ground = analyse(scene_of(writer.bytes()))
    assert np.isclose(ground.resolution[:8], 15 * 2.0**-23).all()
    assert np.isclose(ground.resolution[8:], 15 * 2.0**-9, rtol=1e-3).all()
