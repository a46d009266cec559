from pathlib import Path

import numpy as np
import pytest

from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import MODEL_SIZE
from core.lab.attacks.attack import ATTACKS, Target, attack_file
from core.lab.attacks.plain_file import read_plain
from core.lab.benchmark.bench import moved_points
from core.lab.plain import Mesh
from core.metrics.topology import topology
from core.parameters import Parameters
from core.pipeline import watermark
from tests.core.formats.meshes import MESHES
from tests.core.lab.attacks.settings import area, boxes_at, mesh_of, target_of
from tests.core.placement.shapes import moved, sphere

SPOT = Path(__file__).parents[3] / "data" / "spot.glb"
REAL = sorted(path for path in MESHES.glob("*.*") if path.suffix not in (".csv", ".md") and path.stat().st_size < 2**19)


@pytest.fixture(scope="module")
def marked() -> bytes:
    return watermark(SPOT.read_bytes(), Parameters(text="SAMPLE", count=4, evaluate=Evaluate.NONE)).model


def world(data: bytes) -> Mesh:
    surface = read_plain(data)
    return Mesh(surface.to_world(surface.positions), surface.faces)


@pytest.mark.parametrize("name", ATTACKS)
def test_every_attack_turns_a_watermarked_file_into_a_readable_one_and_always_the_same(
    name: str, marked: bytes
) -> None:
    first, again = (attack_file(marked, name, None, 7, SPOT.read_bytes()) for _ in range(2))
    assert first == again
    assert len(read_plain(first).faces) > 100


@pytest.mark.parametrize("name", ATTACKS)
def test_the_surface_is_still_where_an_attack_says_that_it_left_a_mark(name: str, marked: bytes) -> None:
    original = read_plain(SPOT.read_bytes())
    surface = read_plain(marked).in_frame_of(original)
    order = original.positions.argsort(axis=0)
    furthest = original.positions[order[[0, -1]].ravel()]  # both ways along each axis
    index, rng = SpatialIndex(original.positions, original.faces), np.random.default_rng(1)
    target = Target(index, boxes_at(*furthest.tolist()), rng)
    attacked = ATTACKS[name](Mesh(surface.positions, surface.faces), target)

    linear = attacked.transform[:3, :3]
    scale = float(np.cbrt(np.linalg.det(linear)))
    np.testing.assert_allclose(linear @ linear.T, scale**2 * np.eye(3), atol=1e-9 * scale**2)
    left = moved_points(furthest[attacked.kept], attacked.transform)
    distance, _, _ = SpatialIndex(attacked.mesh.positions, attacked.mesh.faces).closest(left)
    assert len(left) > 0
    assert distance.max() < 0.04 * MODEL_SIZE * scale


@pytest.mark.parametrize("original", [None, SPOT.read_bytes()], ids=["alone", "beside the original"])
def test_an_attacked_file_keeps_its_units_and_place(original: bytes | None, marked: bytes) -> None:
    before, after = world(marked).positions, world(attack_file(marked, "noise", None, 0, original)).positions
    size = np.ptp(before, axis=0).max()
    assert np.abs(after.min(axis=0) - before.min(axis=0)).max() < 0.04 * size
    assert np.abs(after.max(axis=0) - before.max(axis=0)).max() < 0.04 * size


def test_removing_the_letters_of_a_real_asset_leaves_holes_and_the_trenches_round_them(marked: bytes) -> None:
    original = world(SPOT.read_bytes())
    rest = world(attack_file(marked, "removal", None, 0, SPOT.read_bytes()))
    assert 0.97 * area(original) < area(rest) < 0.999 * area(original)
    assert not topology(rest.surface()).watertight
    index = SpatialIndex(original.positions, original.faces)
    distance, face, foot = index.closest(rest.positions)
    above = np.einsum("vi,vi->v", rest.positions - foot, index.normals(face))
    assert above.max() < 1e-4, "nothing stands out"
    assert 1e-3 < distance.max() * 30 / np.ptp(original.positions, axis=0).max() < 0.05, "but trenches are left"


def test_a_removal_without_the_original_says_what_is_missing(marked: bytes) -> None:
    with pytest.raises(MeshmarkError) as refused:
        attack_file(marked, "removal", None, 0, None)
    assert refused.value.code is ErrorCode.INVALID_PARAMETERS
    assert "original" in refused.value.message


def test_an_unknown_attack_is_answered_with_the_known_ones(marked: bytes) -> None:
    with pytest.raises(MeshmarkError) as refused:
        attack_file(marked, "melt", None, 0, None)
    assert "decimate" in refused.value.remedy


@pytest.mark.parametrize(
    ("name", "strength"), [("crop", 1.0), ("decimate", 0.0), ("scale", -2), ("noise", float("nan"))]
)
def test_a_strength_out_of_range_is_refused(name: str, strength: float) -> None:
    ball = mesh_of(sphere(3, rings=6))
    with pytest.raises(MeshmarkError) as refused:
        ATTACKS[name](ball, target_of(ball), strength)
    assert refused.value.code is ErrorCode.INVALID_PARAMETERS


@pytest.mark.parametrize("name", [name for name in ATTACKS if name != "removal"])
def test_the_boundaries_of_each_strength_work(name: str) -> None:
    ball = mesh_of(moved(sphere(15, rings=8), shift=(1, 2, 3)))
    attack = ATTACKS[name]
    for strength in (attack.low, attack.high) if name != "remesh" else (1 / 256, attack.high):
        assert np.isfinite(attack(ball, target_of(ball), strength).mesh.positions).all()


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_real_assets_survive_every_attack_on_geometry(path: Path) -> None:
    mesh = world(path.read_bytes())
    for name in ("crop", "decimate", "smooth", "noise", "reexport"):
        attacked = ATTACKS[name](mesh, target_of(mesh)).mesh
        assert len(attacked.faces) > 0
        assert np.isfinite(attacked.positions).all()
