"""A watermark on an animated asset moves with it."""

import os
from pathlib import Path

import numpy as np
import pytest

from core.choices import Evaluate
from core.geometry.spatial import SpatialIndex
from core.gltf.document import Document
from core.gltf.scene import flatten
from core.parameters import Parameters
from core.pipeline import watermark
from tests.animation import duration, posed

MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", "../shared/meshes"))
NAMES = ("cesium-man", "fox", "mage-kaykit", "morph-stress-test")
ANIMATED = [path for path in (MESHES / f"{name}.glb" for name in NAMES) if path.exists()]


@pytest.mark.parametrize("path", ANIMATED, ids=lambda path: path.stem)
def test_letters_keep_their_distance_from_the_skin_in_every_pose(path: Path) -> None:
    before = Document.from_glb(path.read_bytes())
    asked = Parameters(text="watermark", count=8, evaluate=Evaluate.NONE, seed=1)
    result = watermark(path.read_bytes(), asked, preview=False)
    after = Document.from_glb(result.model)
    rest = flatten(before).surface
    marked = flatten(after).surface.in_frame_of(rest)
    distance, _, _ = SpatialIndex(rest.positions, rest.faces).closest(marked.positions)
    relief = np.array([mark["relief"] for mark in result.report["watermarks"]]) * rest.scale
    tops = np.flatnonzero(distance > relief.min() / 2)
    assert len(tops) > 1000
    for share in (0.15, 0.5, 0.85):
        time = share * duration(before, 0)
        skin = flatten(posed(before, 0, time)).surface
        moved = flatten(posed(after, 0, time)).surface.in_frame_of(skin)
        # Seen from its own size: a pose may stretch the asset's largest side, which sets the frame.
        posed_distance, _, _ = SpatialIndex(skin.positions, skin.faces).closest(moved.positions[tops])
        ratio = posed_distance / skin.scale / (distance[tops] / rest.scale)
        # Where joints bend, a skin blended linearly is squeezed or stretched, and the letters on it with it.
        assert np.median(ratio) == pytest.approx(1.0, abs=0.02)
        assert np.percentile(ratio, 5) > 0.8
        assert np.percentile(ratio, 95) < 1.25
