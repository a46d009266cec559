"""What becomes of the places chosen for watermarks: embossed, or refused and replaced by others."""

from typing import Any

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold, OpType

from core import marking
from core.arrays import Bool
from core.budgets import DEFAULT_BUDGETS
from core.choices import Evaluate
from core.embossing import emboss, marks
from core.embossing.emboss import Mark
from core.embossing.islands import letters_of
from core.embossing.marks import MarkOptions, emboss_marks
from core.embossing.mesh import WorkingMesh
from core.embossing.refusal import EXPLAINED, Refusal
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.parameters import Parameters
from core.pipeline import run_stages, watermark
from core.placement import place
from core.placement.objective import Objective, Placement
from core.placement.options import PLACEMENT, PlacementOptions
from core.stages import Request, Run

CUBE = trimesh.creation.box(extents=(2, 2, 2)).export(file_type="glb")


def request(options: PlacementOptions = PLACEMENT, count: int = 16) -> Request:
    """Marks on an asset, sixteen or so many, and nothing else."""
    asked = Parameters(text="watermark", count=count, evaluate=Evaluate.NONE).resolved()
    return Request(asked, preview=False, options=options)


class Cutter:
    """Embosses as the product does, but refuses ``times`` places on the front of the asset, or only the ``pooled``
    ones, those of before the first search; counts searches."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, times: int, pooled: bool) -> None:
        self.left, self.searches, self._pooled = times, 0, pooled
        self._emboss, self._more = emboss.emboss, place.search_again
        monkeypatch.setattr("core.embossing.marks.emboss", self.emboss)
        monkeypatch.setattr("core.embossing.marks.search_again", self.search_again)

    def emboss(self, mesh: WorkingMesh, box: Boxes, *rest: Any) -> Mark | Refusal:
        if self.left and box.axes[0, 2, 2] > 0.9:
            self.left -= 1
            return Refusal.NOT_WHOLE
        return self._emboss(mesh, box, *rest)

    def search_again(self, *arguments: Any) -> Placement:
        self.searches += 1
        if self._pooled:
            self.left = 0
        return self._more(*arguments)


def cube_marks(
    monkeypatch: pytest.MonkeyPatch,
    refused: int,
    pooled: bool = False,
    options: PlacementOptions = PLACEMENT,
    count: int = 16,
) -> tuple[set[tuple[int, ...]], int]:
    """The sides of a cube that get marks when so many places on its front are refused, and how often places are
    searched for again."""
    cutter = Cutter(monkeypatch, refused, pooled)
    found = run_stages(CUBE, request(options, count)).report["watermarks"]
    return {tuple(np.round(mark["normal"]).astype(int).tolist()) for mark in found}, cutter.searches


def test_where_one_cut_is_refused_another_place_takes_its_part(monkeypatch: pytest.MonkeyPatch) -> None:
    sides, searches = cube_marks(monkeypatch, refused=1)
    assert len(sides) == 6
    assert searches == 0


def test_where_all_places_on_a_side_are_refused_more_are_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """As long as the other sides have not got all the marks that were asked for."""
    sides, searches = cube_marks(monkeypatch, refused=10_000, pooled=True, count=32)
    assert len(sides) == 6
    assert searches == 1


def test_places_over_thin_walls_are_left_to_others_that_cover_as_much(monkeypatch: pytest.MonkeyPatch) -> None:
    before = {tuple(mark["center"]) for mark in run_stages(CUBE, request()).report["watermarks"]}
    units = marking.read(CUBE, DEFAULT_BUDGETS).scene.surface

    def thin(boxes: Boxes, *_: Any) -> Bool:
        centers = boxes.center / units.scale + units.offset
        return np.array([np.linalg.norm(one - list(before), axis=1).min() < 0.05 for one in centers])

    monkeypatch.setattr("core.embossing.marks.hold_other_side", thin)
    after = {tuple(mark["center"]) for mark in run_stages(CUBE, request()).report["watermarks"]}
    assert len(after) >= len(before)
    assert np.linalg.norm(np.array(list(after))[:, None] - list(before), axis=2).min() > 0.04


def test_a_side_on_which_a_search_found_nothing_either_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    sides, searches = cube_marks(monkeypatch, refused=10_000)
    assert len(sides) == 5
    assert searches == 1


@pytest.mark.parametrize("refused", [1, 10_000])
def test_where_every_mark_costs_more_than_it_shows_the_search_still_ends(
    monkeypatch: pytest.MonkeyPatch, refused: int
) -> None:
    sides, searches = cube_marks(monkeypatch, refused, options=PlacementOptions(objective=Objective(mark=1.0)))
    assert len(sides) == 1
    assert searches <= 1


def test_however_much_each_search_regains_there_are_only_so_many(monkeypatch: pytest.MonkeyPatch) -> None:
    cutter = Cutter(monkeypatch, times=10_000, pooled=False)
    run = Run(request(), lambda _: None, lambda *_: None)
    asset, layouts = marking.read(CUBE, DEFAULT_BUDGETS), marking.letter(run)
    found = marking.place(asset, layouts, run)
    mesh = WorkingMesh(asset.scene.surface, found.context.carrier.cuttable, asset.analysis.coincident)
    insatiable = MarkOptions(max_searches=3, min_improvement=-1.0)
    emboss_marks(mesh, found.context, found.placement, letters_of(layouts), found.rng, options=insatiable)
    assert cutter.searches == 3


def lattice(cells: int) -> bytes:
    """A frame of round bars, united into one surface with the cracks that float32 leaves at the crossings."""
    bars = [
        Manifold.cylinder(cells + 0.3, 0.15, 0.15, 24, True)
        .rotate(([0, 90, 0], [90, 0, 0], [0, 0, 0])[axis])
        .translate(np.roll([0, one - cells / 2, other - cells / 2], axis))
        for axis in range(3)
        for one in range(cells + 1)
        for other in range(cells + 1)
    ]
    mesh = Manifold.batch_boolean(bars, OpType.Add).to_mesh()
    frame = trimesh.Trimesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts), process=False)
    exported = frame.export(file_type="glb")
    assert isinstance(exported, bytes)
    return exported


def test_hardly_any_cut_is_wasted_on_cracks_and_low_steps() -> None:
    done = watermark(lattice(4), Parameters(text="watermark", evaluate=Evaluate.NONE), preview=False).report[
        "embossing"
    ]
    assert done["verified"] >= 12  # 1 of 304 that were tried before the edges were looked at
    assert sum(done["refused"].values()) <= done["verified"]


def test_what_was_refused_teaches_where_not_to_try(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("core.placement.context.rims", lambda *_: None)
    asked, frame = Parameters(text="watermark", evaluate=Evaluate.NONE), lattice(3)
    taught = watermark(frame, asked, preview=False).report["embossing"]
    monkeypatch.setattr(marks, "_over", lambda *_: set())
    untaught = watermark(frame, asked, preview=False).report["embossing"]
    assert sum(taught["refused"].values()) < 0.9 * sum(untaught["refused"].values())
    assert taught["verified"] >= untaught["verified"]


@pytest.mark.parametrize(
    ("reason", "said", "advised"),
    [
        (Refusal.THIN_WALL, "sunken letters would come through", "`relief`"),
        (Refusal.TOO_FINE, "32-bit coordinates are too coarse", "Move the model"),
        (Refusal.TOO_DENSE, "more triangles", "reduce the number"),
        (Refusal.FOLDED, "too strongly curved", "`relief`"),
    ],
)
def test_where_every_cut_is_refused_the_error_names_the_reason_and_what_helps_against_it(
    monkeypatch: pytest.MonkeyPatch, reason: Refusal, said: str, advised: str
) -> None:
    monkeypatch.setattr("core.embossing.marks.emboss", lambda *_: reason)
    with pytest.raises(MeshmarkError) as caught:
        watermark(CUBE, Parameters(text="watermark", count=1, evaluate=Evaluate.NONE), preview=False)
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert said in caught.value.message
    assert advised in caught.value.remedy


def test_every_reason_for_a_refusal_is_explained() -> None:
    assert set(EXPLAINED) == set(Refusal)
