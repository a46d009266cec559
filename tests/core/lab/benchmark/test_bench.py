"""Real meshes on the bench: what is measured after an attack, and a whole small benchmark."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.gltf.scene import flatten
from core.lab.attacks.ladder import LADDER
from core.lab.attacks.target import letter_faces
from core.lab.baselines import STRATEGIES
from core.lab.baselines.strategy import Marked, Prepared
from core.lab.benchmark.bench import AssetBench, moved_boxes, moved_points
from core.lab.benchmark.options import AttackRequest, BenchmarkOptions
from core.lab.benchmark.run import run
from core.lab.plain import plain
from core.metrics.ocr import Ocr
from core.parameters import Parameters
from tests.core.lab.benchmark.fakes import options

SPOT = Path(__file__).parents[3] / "data" / "spot.glb"


@given(st.integers(0, 10**6), st.floats(0.1, 10))
def test_boxes_move_with_their_corners(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    transform = np.eye(4)
    transform[:3, :3] = Rotation.random(rng=rng).as_matrix() * scale
    transform[:3, 3] = rng.normal(size=3)
    axes = Rotation.random(3, rng=rng).as_matrix()
    boxes = Boxes(rng.normal(size=(3, 3)), axes, rng.uniform(0.5, 2, size=(3, 3)))
    there = moved_boxes(boxes, transform)
    expected = moved_points(boxes.corners().reshape(-1, 3), transform)
    np.testing.assert_allclose(there.corners().reshape(-1, 3), expected, atol=1e-9)
    np.testing.assert_allclose(there.axes @ there.axes.transpose(0, 2, 1), np.tile(np.eye(3), (3, 1, 1)), atol=1e-9)


@pytest.fixture(scope="module")
def bench() -> AssetBench:
    asked = BenchmarkOptions(Path(), Path(), methods=("li",), counts=(4,), level=Evaluate.GEOMETRY)
    return AssetBench(SPOT.read_bytes(), 0, asked)


def test_moving_an_asset_changes_nothing_that_does_not_depend_on_size(bench: AssetBench) -> None:
    trial = bench.mark("li", 4)
    still = bench.measure(trial, AttackRequest("none"))["metrics"]
    for name, strength in (("translate", 1.0), ("scale", 10.0)):
        moved = bench.measure(trial, AttackRequest(name, strength))["metrics"]
        for metric in ("wps", "wps_area", "ray", "coverage", "ipe"):
            assert moved[metric] == pytest.approx(still[metric], abs=1e-3), (name, metric)


def test_marks_that_were_cut_away_are_not_measured_and_their_share_is_told(bench: AssetBench) -> None:
    trial = bench.mark("li", 4)
    cut = bench.measure(trial, AttackRequest("crop", 0.999))
    assert cut["survived"] == 0.0
    assert cut["metrics"]["ray"] == cut["metrics"]["coverage"] == 0.0
    assert cut["metrics"]["wps"] is None
    assert cut["missing"]["wps"] == "invalid_request"


def test_a_letters_colour_stays_on_it_through_decimation(bench: AssetBench) -> None:
    trial = bench.mark("li", 4)
    original = bench._prepared.index
    share = {}
    for attack in (AttackRequest("none"), AttackRequest("decimate", 0.5), AttackRequest("scale", 10.0)):
        attacked = bench._attacked(trial.marked, attack, {})
        letters = trial.letters(attacked, original)
        areas = attacked.mesh.surface().areas
        share[attack.name] = areas[letters].sum() / areas.sum()
        if attack.name == "none":
            np.testing.assert_array_equal(letters, letter_faces(trial.marked.mesh, original))
    assert 0 < share["none"] < 0.5
    assert share["decimate"] == pytest.approx(share["none"], rel=0.25)
    assert share["scale"] == pytest.approx(share["none"], rel=1e-6)


def test_an_invisible_watermark_is_read_back_and_has_no_ray(bench: AssetBench) -> None:
    found = bench.measure(bench.mark("invisible", 0), AttackRequest("none"))
    assert found["bit_accuracy"] == 1.0
    assert found["marks"] is None
    assert found["metrics"]["ray"] == 0.0
    assert 0 < found["metrics"]["smse"] < 0.1


def test_shared_steps_count_for_every_method_that_needs_them(bench: AssetBench) -> None:
    first, second = bench.mark("li", 4).seconds, bench.mark("li", 4).seconds
    assert first["solid"] == second["solid"]
    assert first["run"] == pytest.approx(first["reading"] + first["solid"] + first["marking"], abs=1e-3)
    assert "reading" not in bench.mark("meshmark", 1).seconds


def test_our_own_pipeline_is_asked_for_the_colour_that_letters_are_read_in(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Parameters] = []

    def strategy(_prepared: Prepared, parameters: Parameters, _rng: np.random.Generator) -> Marked:
        asked.append(parameters)
        raise MeshmarkError(ErrorCode.NO_PLACEMENT, "", "")

    monkeypatch.setitem(STRATEGIES, "meshmark", strategy)
    for color in (None, "#d02020"):
        bench = AssetBench(SPOT.read_bytes(), 0, BenchmarkOptions(Path(), Path(), color=color))
        with pytest.raises(MeshmarkError):
            bench.mark("meshmark", 4)
    assert [one.color for one in asked] == ["none", "#d02020"]


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[NDArray[np.uint8]]:
    """The pictures that are read, of each of which half is."""
    found: list[NDArray[np.uint8]] = []

    def read(pictures: NDArray[np.uint8], *_: object) -> Ocr:
        found.append(pictures)
        return Ocr(0.5, 0.25, 0.125, np.full(len(pictures), 0.5))

    for module in ("core.lab.benchmark.bench", "core.metrics.measure"):
        monkeypatch.setattr(f"{module}.ocr", read)
    return found


def test_what_a_user_gets_is_read_in_its_own_materials_and_everything_else_as_grey_clay(
    monkeypatch: pytest.MonkeyPatch, seen: list[NDArray[np.uint8]]
) -> None:
    def strategy(prepared: Prepared, _parameters: Parameters, _rng: np.random.Generator) -> Marked:
        scene = flatten(document_of(admit(prepared.data)))
        return Marked(plain(scene.surface), Boxes.empty(), np.empty(0), scene)

    monkeypatch.setitem(STRATEGIES, "meshmark", strategy)
    asked = BenchmarkOptions(Path(), Path(), views=1, resolution=96)
    bench = AssetBench(SPOT.read_bytes(), 0, asked)
    found = bench.measure(bench.mark("meshmark", 4), AttackRequest("none"))
    assert bench.facts()["textured"]
    assert found["metrics"]["ocr_delivered"] == 0.5
    assert found["metrics"]["ocr_delivered_ge_0.8"] == 0.25
    clay, delivered = (pictures.astype(int) for pictures in seen)
    assert np.ptp(clay, axis=-1).max() == 0
    assert np.ptp(delivered, axis=-1).max() > 10
    crop = bench.measure(bench.mark("meshmark", 4), AttackRequest("crop", 0.5))
    assert "ocr_delivered" not in crop["metrics"]


def test_through_the_holes_of_an_attack_is_seen_what_the_assets_own_materials_show(
    monkeypatch: pytest.MonkeyPatch, seen: list[NDArray[np.uint8]]
) -> None:
    def strategy(prepared: Prepared, _parameters: Parameters, _rng: np.random.Generator) -> Marked:
        return Marked(plain(prepared.surface), Boxes.empty(), np.empty(0))

    monkeypatch.setitem(STRATEGIES, "li", strategy)
    bench = AssetBench(SPOT.read_bytes(), 0, BenchmarkOptions(Path(), Path(), views=24, resolution=96))
    trial = bench.mark("li", 4)
    drawn = {}
    for backs in (False, True):
        bench._prepared.double_sided = backs
        for attack in (AttackRequest("none"), AttackRequest("crop", 0.5)):
            seen.clear()
            bench.measure(trial, attack)
            drawn[backs, attack.name] = int((seen[0] < 230).all(axis=-1).sum())
    assert drawn[False, "none"] == pytest.approx(drawn[True, "none"], rel=1e-3)
    assert drawn[False, "crop"] < 0.95 * drawn[True, "crop"]


def test_what_a_thief_gets_is_measured_and_letters_that_he_leaves_keep_their_colour(
    seen: list[NDArray[np.uint8]],
) -> None:
    bench = AssetBench(SPOT.read_bytes(), 0, BenchmarkOptions(Path(), Path(), views=24, resolution=96))
    trial = bench.mark("meshmark-default", 6)
    red = {}
    for name in ("thief-restore", "thief-by-material", "thief-lower"):
        seen.clear()
        found = bench.measure(trial, AttackRequest(name, LADDER[name].strength))["metrics"]
        red[name] = bool(np.ptp(seen[0].astype(int), axis=-1).max() > 60)
        assert found["ocr"] == found["ocr_relief"] == 0.5
        # As much is read on the bare asset, so that nothing counts as read: what is left is the shape.
        assert found["stripped"] == float(found["recovered"] >= 0.9)
        assert (found["recovered"] == 0) == (name == "thief-restore")
    assert red == {"thief-restore": True, "thief-by-material": False, "thief-lower": True}
    geometry = AssetBench(SPOT.read_bytes(), 0, BenchmarkOptions(Path(), Path(), level=Evaluate.GEOMETRY))
    assert "stripped" not in geometry.measure(trial, AttackRequest("thief-restore", 1))["metrics"]


def test_a_small_benchmark_from_files_to_report(tmp_path: Path) -> None:
    asked = options(tmp_path, counts=(4,), processes=2)
    shutil.copy(SPOT, asked.folder)
    block = trimesh.creation.box(extents=(3, 2, 1)).subdivide().subdivide().subdivide()
    block.export(asked.folder / "block.stl")
    (asked.folder / "notes.txt").write_text("not a mesh")
    rows = run(asked)
    assert [(row["asset"], row["method"], row["attack"], row["status"]) for row in rows] == [
        (asset, method, attack, "ok")
        for asset in ("block.stl", "spot.glb")
        for method in ("meshmark", "li")
        for attack in ("none", "crop")
    ]
    for row in rows:
        assert row["marks"] == 4
        assert row["vertices"] == {"block.stl": 386, "spot.glb": 2930}[row["asset"]]
        assert row["metrics"]["smse"] > 0
        assert row["metrics"]["ocr"] is None
        assert row["missing"]["ocr"] == "not_requested"
        assert 0 <= row["survived"] <= 1
    by = {(row["method"], row["attack"]): row["metrics"] for row in rows if row["asset"] == "spot.glb"}
    assert by["meshmark", "none"]["ipe"] == 0
    assert by["meshmark", "none"]["wps_area"] > by["li", "none"]["wps_area"]
    text = (asked.out / "REPORT.md").read_text()
    assert "| meshmark | 4 | 2 of 2 (100%) | 4 | - |" in text
    assert "![run-time](run-time.png)" in text
