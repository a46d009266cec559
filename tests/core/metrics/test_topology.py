import numpy as np

from core.metrics.topology import topology
from tests.core.placement.shapes import cuboid, join, moved, plane, sphere, surface


def test_a_closed_block_is_one_watertight_part() -> None:
    found = topology(cuboid(1, 2, 3))
    assert (found.components, found.boundary_edges, found.nonmanifold_edges) == (1, 0, 0)
    assert found.watertight


def test_a_sheet_has_its_outline_as_boundary() -> None:
    found = topology(plane(2, 2, cells=3))
    assert (found.components, found.boundary_edges, found.nonmanifold_edges) == (1, 12, 0)
    assert not found.watertight


def test_vertices_at_equal_positions_are_one_vertex() -> None:
    whole = sphere(3, rings=6)
    corners = whole.positions[whole.faces].reshape(-1, 3)
    soup = surface(corners, np.arange(len(corners)).reshape(-1, 3))
    assert topology(soup) == topology(whole)


def test_parts_that_share_only_a_vertex_are_two_parts() -> None:
    one = cuboid(1, 1, 1)
    assert topology(join(one, moved(one, shift=(1, 1, 1)))).components == 2


def test_parts_that_share_an_edge_are_one_part_and_the_edge_is_nonmanifold() -> None:
    fin = surface(np.array([[-0.5, -0.5, -0.5], [-0.5, -0.5, 0.5], [-2, -2, 0]]), np.array([[0, 1, 2]]))
    found = topology(join(cuboid(1, 1, 1), fin))
    assert (found.components, found.boundary_edges, found.nonmanifold_edges) == (1, 2, 1)
    assert not found.watertight


def test_faces_collapsed_to_a_line_are_left_out() -> None:
    block = cuboid(1, 1, 1)
    collapsed = surface(block.positions, np.concatenate([block.faces, [[0, 0, 1], [2, 2, 2]]]))
    assert topology(collapsed) == topology(block)


def test_no_faces_make_no_parts() -> None:
    assert topology(surface(np.zeros((1, 3)), np.empty((0, 3), dtype=np.int64))).components == 0
