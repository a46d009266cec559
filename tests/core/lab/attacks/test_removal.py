import numpy as np
import pytest

from core.errors import ErrorCode, MeshmarkError
from core.geometry.spatial import SpatialIndex
from core.lab.attacks.removal import removal
from core.lab.attacks.target import Target, letter_faces
from core.lab.plain import Mesh
from core.metrics.topology import topology
from tests.core.lab.attacks.settings import area, boxes_at, mesh_of, target_of
from tests.core.placement.shapes import join, moved, plane, surface

GROUND = mesh_of(plane(4, 4, cells=4))


def embossed() -> Mesh:
    """The ground with a square block of 2 x 2 x 0.3 stitched into its middle, the surface under it removed."""
    centers = GROUND.positions[GROUND.faces].mean(axis=1)
    outside = (np.abs(centers[:, :2]) > 1).any(axis=1)
    rim = np.array([[-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]], dtype=float)
    low, high = (np.column_stack([rim, np.full(8, z)]) for z in (0, 0.3))
    ahead = np.roll(np.arange(8), -1)
    walls = [f for i, j in enumerate(ahead) for f in ((i, j, j + 8), (i, j + 8, i + 8))]
    cap = [(8 + i, 8 + j, 16) for i, j in enumerate(ahead)]
    block = surface(np.concatenate([low, high, [[0, 0, 0.3]]]), np.array(walls + cap))
    return mesh_of(join(surface(GROUND.positions, GROUND.faces[outside]), block))


def aimed_at_ground(seed: int = 0) -> Target:
    return Target(SpatialIndex(GROUND.positions, GROUND.faces), boxes_at((0, 0, 0)), np.random.default_rng(seed))


def test_removing_a_letter_leaves_a_hole_of_its_outline() -> None:
    assert topology(embossed().surface()).components == 1
    attacked = removal(embossed(), aimed_at_ground())
    assert area(attacked.mesh) == pytest.approx(12)
    assert np.abs(attacked.mesh.positions[:, 2]).max() == 0
    corners = attacked.mesh.positions[attacked.mesh.faces].mean(axis=1)
    assert (np.abs(corners[:, :2]).max(axis=1) > 1).all()
    assert attacked.kept.tolist() == [True]


def test_the_faces_of_a_letter_are_its_walls_and_its_cap() -> None:
    letters = letter_faces(embossed(), aimed_at_ground().original_index)
    assert letters.sum() == 24
    assert embossed().surface().areas[letters].sum() == pytest.approx(4 + 8 * 0.3)


@pytest.mark.parametrize("side", [1, -1])
def test_the_trench_round_smooth_letters_is_ground(side: int) -> None:
    """A block whose feet lie in a trench a third as deep, raised or sunken."""
    block = embossed()
    positions = block.positions.copy()
    foot = (positions[:, 2] == 0) & (np.abs(positions[:, :2]).max(axis=1) == 1)
    positions[foot, 2] = -0.1
    marked = Mesh(positions * (1, 1, side), block.faces)
    letters = letter_faces(marked, aimed_at_ground().original_index)
    high = (side * marked.positions[marked.faces][:, :, 2]).max(axis=1) > 0
    np.testing.assert_array_equal(letters, high)
    assert 0 < letters.sum() < len(letters)


def test_a_letter_that_floats_above_the_surface_leaves_nothing() -> None:
    floating = mesh_of(join(plane(4, 4, cells=4), moved(plane(1, 1), shift=(0, 0, 0.2))))
    rest = removal(floating, aimed_at_ground()).mesh
    assert area(rest) == pytest.approx(16)
    assert len(rest.positions) == len(GROUND.positions)


def test_half_the_strength_finds_half_of_the_letters() -> None:
    many = mesh_of(join(plane(4, 4, cells=4), moved(plane(1, 1, cells=30), shift=(0, 0, 0.2))))
    left = len(removal(many, aimed_at_ground(), 0.5).mesh.faces) - len(GROUND.faces)
    assert left == pytest.approx(900, rel=0.1)


def test_an_asset_without_letters_has_nothing_to_remove() -> None:
    with pytest.raises(MeshmarkError) as refused:
        removal(GROUND, target_of(GROUND))
    assert refused.value.code is ErrorCode.INVALID_PARAMETERS


def test_another_original_is_refused_instead_of_removing_everything() -> None:
    elsewhere = mesh_of(moved(plane(4, 4), shift=(0, 0, 5)))
    with pytest.raises(MeshmarkError) as refused:
        removal(GROUND, target_of(elsewhere))
    assert refused.value.code is ErrorCode.NO_FACES
