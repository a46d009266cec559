"""What a thief gets who has only the marked file."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.choices import Evaluate, Profile
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.gltf.scene import Scene, scene_of
from core.lab.attacks.ladder import LADDER
from core.lab.attacks.letters import by_edges, by_height, by_material, by_order, by_remains
from core.lab.attacks.target import Target, letter_faces
from core.lab.benchmark.theft import recovered
from core.lab.plain import Mesh, plain
from core.parameters import Parameters
from core.pipeline import watermark
from core.report import Report
from tests.core.gltf.builder import Builder

SPOT = Path(__file__).parents[3] / "data" / "spot.glb"
RED, NONE = "#d02020", "none"


class Stolen:
    """Spot with four marks, before and after a thief."""

    def __init__(self, **asked: Any) -> None:
        parameters = Parameters.model_validate({"text": "watermark", "count": 4, "evaluate": Evaluate.NONE} | asked)
        result = watermark(SPOT.read_bytes(), parameters)
        clean = scene_of(SPOT.read_bytes()).surface
        self.scene: Scene = scene_of(result.model)
        self.mesh: Mesh = plain(self.scene.surface.in_frame_of(clean))
        self.clean: Mesh = plain(clean)
        marks = Report.model_validate(result.report).watermarks
        self.boxes = Boxes(
            np.array([mark.center for mark in marks]),
            np.array([[mark.right, mark.up, mark.normal] for mark in marks]),
            np.array([mark.size for mark in marks]),
        ).to_frame(clean.offset, clean.scale)
        self.index = SpatialIndex(self.clean.positions, self.clean.faces)
        self.letters = letter_faces(self.mesh, self.index)

    def regained(self, name: str) -> float:
        target = Target(self.index, self.boxes, np.random.default_rng(0), self.scene)
        attacked = LADDER[name](self.mesh, target)
        assert attacked.source is not None
        assert len(attacked.source) == len(attacked.mesh.faces)
        return recovered(self.clean, self.mesh, attacked.mesh, self.boxes)


@pytest.fixture(scope="module")
def soft() -> Stolen:
    return Stolen(color=NONE)


@pytest.fixture(scope="module")
def flat() -> Stolen:
    return Stolen(color=NONE, profile=Profile.FLAT)


@pytest.fixture(scope="module")
def red() -> Stolen:
    return Stolen(color=RED)


def test_flat_letters_are_cut_out_along_their_edges_and_the_clean_shape_is_back(flat: Stolen) -> None:
    assert flat.regained("thief-strip") > 0.95


@pytest.mark.parametrize("attack", LADDER)
def test_no_thief_gets_the_clean_shape_back_from_soft_letters(soft: Stolen, attack: str) -> None:
    assert soft.regained(attack) < 0.9


def test_soft_letters_have_no_edges_to_cut_along(soft: Stolen, flat: Stolen) -> None:
    assert soft.regained("thief-strip") < 0.1
    found = [by_edges(one.mesh)[one.letters].mean() for one in (soft, flat)]
    assert found[0] < 0.2
    assert found[1] > 0.99


def test_a_file_without_colours_has_no_letters_by_material_order_or_remains(soft: Stolen) -> None:
    for find in (by_material, by_order, by_remains):
        assert not find(soft.scene, soft.mesh).any()
    for attack in ("thief-by-material", "thief-by-order", "thief-restore"):
        assert soft.regained(attack) == 0


def test_letters_of_a_colour_are_found_by_it_and_their_trenches_are_not(red: Stolen) -> None:
    found = by_material(red.scene, red.mesh)
    assert found.any()
    assert red.letters[found].mean() > 0.9
    assert 0 < red.regained("thief-by-material") < 0.9


def test_what_stands_out_is_found_by_its_height(flat: Stolen) -> None:
    found = by_height(flat.mesh)
    areas = flat.mesh.surface().areas
    assert areas[found & flat.letters].sum() > 0.6 * areas[flat.letters].sum()
    assert areas[found & ~flat.letters].sum() < 0.2 * areas.sum()


def appended(dead: bool) -> tuple[Scene, Mesh]:
    """A plate of two triangles and, behind them, six loose ones; and vertices that nothing draws, if ``dead``."""
    corners = [[0, 0, 0], [30, 0, 0], [30, 30, 0], [0, 30, 0]]
    letters = [[x + dx, 10 + dy, 1] for x in range(2, 26, 4) for dx, dy in ((0, 0), (1, 0), (0, 1))]
    rows = corners + letters + ([[15, 29, 0]] if dead else [])
    builder = Builder()
    faces = np.concatenate([[[0, 1, 2], [0, 2, 3]], 4 + np.arange(18).reshape(-1, 3)])
    primitive = builder.primitive(rows, faces)
    scene = scene_of(builder.document(meshes=[{"primitives": [primitive]}]).to_glb())
    return scene, plain(scene.surface)


def test_triangles_that_were_appended_are_found_by_their_order() -> None:
    assert by_order(*appended(dead=False)).tolist() == [False] * 2 + [True] * 6


def test_vertices_that_nothing_draws_tell_where_letters_are() -> None:
    assert not by_remains(*appended(dead=False)).any()
    assert by_remains(*appended(dead=True)).tolist() == [False, True] + [False] * 6


def test_a_thief_who_finds_nothing_leaves_the_asset_as_it_is(soft: Stolen) -> None:
    target = Target(soft.index, soft.boxes, np.random.default_rng(0), soft.scene)
    assert LADDER["thief-by-order"](soft.mesh, target).mesh is soft.mesh


def test_what_is_regained_is_one_for_the_clean_shape_and_zero_for_the_marked_one(soft: Stolen) -> None:
    assert recovered(soft.clean, soft.mesh, soft.clean, soft.boxes) == pytest.approx(1)
    assert recovered(soft.clean, soft.mesh, soft.mesh, soft.boxes) == 0
    higher = replace(soft.mesh, positions=soft.mesh.positions + np.array([0, 1, 0]))
    assert recovered(soft.clean, soft.mesh, higher, soft.boxes) < -1
