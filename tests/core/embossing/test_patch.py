import numpy as np
import pytest

from core.arrays import Float, Int
from core.embossing.mesh import WorkingMesh
from core.embossing.patch import MAX_FACES, MAX_PIECES, Patch
from core.embossing.patch import patches as _patches
from core.geometry.boxes import Boxes
from tests.core.embossing.bench import box_at
from tests.core.shapes import box, grid, join, moved, surface


def _mesh(positions: Float, faces: Int) -> WorkingMesh:
    return WorkingMesh(surface(positions, faces), np.ones(len(faces), dtype=bool))


def patches(mesh: WorkingMesh, box: Boxes) -> list[Patch]:
    found = _patches(mesh, box)
    assert found is not None
    return found


def test_only_faces_that_look_at_the_box_are_taken() -> None:
    cube = box(2.0, 2.0, 2.0)
    (patch,) = patches(_mesh(cube.positions, cube.faces), box_at(center=(0.0, 0.0, 1.0)))
    assert len(patch.triangles) == 2
    assert patch.projected_area() * 16 == pytest.approx(4.0)
    assert patch.silhouette().area() * 16 == pytest.approx(4.0)


def test_parts_that_do_not_share_an_edge_are_patches_of_their_own() -> None:
    both = join(grid(2.0, 2.0, 2, 2), moved(grid(2.0, 2.0, 2, 2), 2.5, 0.0, 0.0))
    found = patches(_mesh(both.positions, both.faces), box_at(center=(1.0, 0.0, 0.0)))
    assert sorted(len(patch.triangles) for patch in found) == [8, 8]


def test_the_room_for_letters_keeps_off_every_boundary() -> None:
    sheet = grid(4.0, 4.0, 4, 4)
    (patch,) = patches(_mesh(sheet.positions, sheet.faces), box_at())
    side = 4.0 / 4.0
    assert patch.silhouette().area() == pytest.approx(side * side / 2)  # the two middle rows
    assert patch.inset_silhouette(0.004).area() == pytest.approx((side - 0.008) * (side / 2 - 0.008))


def test_neighbours_that_disagree_about_outside_are_not_joined() -> None:
    positions = np.array([[-2.0, -2, 0], [2, -2, 0], [0, 2, 0], [0, 2, 0.5]])
    faces = np.array([[0, 1, 2], [0, 1, 3]])  # both run along 0-1 in the same direction
    assert len(patches(_mesh(positions, faces), box_at())) == 2


def test_a_box_over_too_many_faces_or_pieces_is_refused_before_any_work() -> None:
    dense = grid(4.0, 0.4, 250, 60)
    assert len(dense.faces) > MAX_FACES
    assert _patches(_mesh(dense.positions, dense.faces), box_at()) is None
    crumb = np.array([[0.0, 0, 0], [1e-3, 0, 0], [0, 1e-3, 0]])
    crumbs = (crumb + np.array([[2e-3 * k - 2.0, 0.0, 0.0]]) for k in range(MAX_PIECES + 1))
    crumbled = np.concatenate(list(crumbs))
    assert _patches(_mesh(crumbled, np.arange(len(crumbled)).reshape(-1, 3)), box_at(width=8.0)) is None


def test_triangles_are_seen_counter_clockwise() -> None:
    sheet = grid(4.0, 4.0, 7, 5)
    for right in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-0.6, 0.8, 0.0)):
        (patch,) = patches(_mesh(sheet.positions, sheet.faces), box_at(right=right))
        a, b, c = (patch.points[patch.triangles[:, k], :2] for k in range(3))
        u, v = b - a, c - a
        assert np.all(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 0)
