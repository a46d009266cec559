import numpy as np
import pytest

from core.geometry.spatial import SpatialIndex
from core.lab.baselines.paper import paper, paper_no_curve_matching, paper_no_filtering, paper_no_optimization
from core.lab.baselines.strategy import Marked, Prepared, Strategy
from core.lab.plain import plain
from core.metrics.lce import lce
from core.placement.filters import overlapping
from core.placement.finetune import ADAM, alignment_loss
from tests.core.lab.baselines.assets import asset, raised, same, wanted, watertight
from tests.core.shapes import sphere, surface

ALL: list[Strategy] = [paper, paper_no_curve_matching, paper_no_optimization, paper_no_filtering]


@pytest.fixture(scope="module")
def egg() -> Prepared:
    ball = sphere(15, 4)
    return asset(surface(ball.positions * [1, 0.8, 0.6], ball.faces))


def run(strategy: Strategy, prepared: Prepared, count: int = 8, seed: int = 0) -> Marked:
    return strategy(prepared, wanted(count), np.random.default_rng(seed))


def test_marks_are_well_aligned_and_apart_and_as_many_as_asked_for(egg: Prepared) -> None:
    marked = run(paper, egg)
    assert len(marked.boxes) == 8
    assert (alignment_loss(marked.boxes, egg.index) < ADAM.threshold).all()
    assert all(overlapping(marked.boxes, one).sum() == 1 for one in range(8))
    assert watertight(marked.mesh)


def test_letters_follow_the_surface_at_the_height_asked_for(egg: Prepared) -> None:
    _, distance = raised(egg, run(paper, egg))
    assert distance == pytest.approx(0.05, rel=0.1)


def test_without_curve_matching_the_same_boxes_carry_flat_text(egg: Prepared) -> None:
    curved, flat = run(paper, egg), run(paper_no_curve_matching, egg)
    assert np.array_equal(curved.boxes.center, flat.boxes.center)
    errors = [lce(egg.index, marked.mesh.surface(), marked.boxes, marked.relief) for marked in (curved, flat)]
    assert errors[0] is not None
    assert errors[1] is not None
    assert errors[0][0] < 1e-5 < 1e-4 < errors[1][0]
    assert watertight(flat.mesh)


def test_without_optimization_boxes_stay_where_they_were_sampled(egg: Prepared) -> None:
    sampled, loss = egg.initial(4.0)
    places = {tuple(center): value for center, value in zip(sampled.center.tolist(), loss, strict=True)}
    used = [places[tuple(center)] for center in run(paper_no_optimization, egg).boxes.center.tolist()]
    assert max(used) <= np.median(loss)


def test_without_filtering_marks_overlap_and_are_taken_however_they_lie(egg: Prepared) -> None:
    fitted = {tuple(center) for center in egg.fitted(4.0)[0].center.tolist()}
    boxes = run(paper_no_filtering, egg, count=40).boxes
    assert len(boxes) == 40
    assert {tuple(center) for center in boxes.center.tolist()} <= fitted
    assert any(overlapping(boxes, one).sum() > 1 for one in range(40))


@pytest.mark.parametrize("strategy", ALL)
def test_the_same_seed_gives_the_same_mesh_and_another_seed_another(egg: Prepared, strategy: Strategy) -> None:
    first, again, other = (run(strategy, egg, 2, seed).mesh for seed in (0, 0, 1))
    assert same(first, again)
    assert not same(first, other)


def test_the_original_surface_between_the_marks_is_kept(egg: Prepared) -> None:
    mesh = run(paper, egg).mesh
    distance, _, _ = SpatialIndex(mesh.positions, mesh.faces).closest(plain(egg.surface).positions)
    assert np.quantile(distance, 0.5) < 1e-9
    assert distance.max() < 0.06
