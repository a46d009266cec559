"""The judge of marks on faces tells a mark on a face from one beside it, whatever the shape of the ground."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from tests.core.gltf.builder import grid
from tests.features import Feature, Labelled, Touched, ground, labelled, measured, row, summary, touched, touching

SPOT = Path(__file__).parent / "data" / "spot.glb"
POINTS, PLANE_FACES = grid(8)
PLANE = POINTS.astype(np.float64)
X, Y, Z = ((PLANE.min(axis=0) + PLANE.max(axis=0)) / 2).tolist()
WIDTH = float(np.ptp(PLANE[:, 0]))


def box(x: float, y: float, z: float, size: tuple[float, float, float]) -> Boxes:
    return Boxes(np.array([[x, y, z]]), np.eye(3)[None], np.array([size]))


def mark(x: float, y: float, z: float, width: float = 0.3) -> dict[str, object]:
    """A mark of a report on the right flank of spot or on its face, which looks along -Z."""
    right = [0.0, 0.0, -1.0] if x > 0 else [-1.0, 0.0, 0.0]
    return {"center": [x, y, z], "right": right, "up": [0.0, 1.0, 0.0], "size": [width, width / 5, 0.01]}


@pytest.fixture(scope="module")
def spot() -> Labelled:
    return next(asset for asset in labelled().values() if asset.file == "spot.glb")


def test_the_ground_of_a_text_is_the_surface_under_it_and_not_its_plane() -> None:
    bent = PLANE.copy()
    bent[:, 2] += 0.05 * WIDTH * (PLANE[:, 0] > X)
    points = ground(box(X, Y, Z, (0.8 * WIDTH, 0.2 * WIDTH, 0.01)), SpatialIndex(bent, PLANE_FACES))[0]
    assert points[:, 2].max() - points[:, 2].min() == pytest.approx(0.05 * WIDTH, rel=1e-4)


def test_a_mark_touches_a_feature_that_one_end_of_it_reaches_into_and_not_one_beside_or_behind_it() -> None:
    index, text = SpatialIndex(PLANE, PLANE_FACES), box(X, Y, Z, (0.5 * WIDTH, 0.1 * WIDTH, 0.01))
    size = (0.1 * WIDTH, 0.1 * WIDTH, 0.02 * WIDTH)
    at_its_end = box(X + 0.29 * WIDTH, Y, Z, size)
    beside = box(X, Y + 0.2 * WIDTH, Z, size)
    behind = box(X, Y, Z - 0.1 * WIDTH, size)
    found = touching(text, Boxes.concat(at_its_end, beside, behind), index)
    assert found.tolist() == [[True, False, False]]


def test_a_mark_on_the_face_of_the_cow_touches_it_and_one_on_the_flank_touches_nothing(spot: Labelled) -> None:
    found = touched(SPOT.read_bytes(), spot, [mark(0.0, 0.6, -0.45), mark(0.4, 0.0, 0.3)])
    assert "face" in {feature.name for feature in found.features[0]}
    assert found.features[1] == ()
    assert (found.touching, found.marks) == (1, 2)


def test_a_bundled_asset_is_marked_and_judged(spot: Labelled) -> None:
    found = measured((SPOT, spot))
    assert found.marks > 5
    assert len(found.features) == found.marks


def test_a_file_that_is_refused_is_said(tmp_path: Path, spot: Labelled) -> None:
    broken = tmp_path / "broken.glb"
    broken.write_bytes(b"glTF")
    found = measured((broken, spot))
    assert found.refused
    assert found.refused in row(found)


def test_assets_that_were_not_tuned_on_are_summed_up_apart(spot: Labelled) -> None:
    face, aside = spot.features[0], spot.model_copy(update={"aside": True})
    lines = list(summary([Touched(spot, 2, ((face,), ())), Touched(aside, 3, ((), (), ()))]))
    assert lines[0] == "tuned on: 1 of 2 marks on 1 assets touch a feature (0.500)"
    assert lines[1] == "aside: 0 of 3 marks on 1 assets touch a feature (0.000)"
    assert lines[2] == "by kind: face 1"


def test_labels_are_right_angled_boxes_of_at_least_twenty_assets_a_third_of_them_aside() -> None:
    assets = list(labelled().values())
    boxes: list[Feature] = [feature for asset in assets for feature in asset.features]
    for one in boxes:
        frame = np.array([one.right, one.up])
        assert frame @ frame.T == pytest.approx(np.eye(2), abs=1e-3)
        assert min(one.size) > 0
    with_features = [asset for asset in assets if asset.features]
    assert len(with_features) >= 20
    assert sum(asset.aside for asset in with_features) >= 0.3 * len(with_features)
    assert Counter(one.kind for one in boxes)["face"] > 10
    assert all(len({one.name for one in asset.features}) == len(asset.features) for asset in assets)
