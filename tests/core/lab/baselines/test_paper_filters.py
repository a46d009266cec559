import numpy as np
import pytest

from core.analysis.saliency import Saliency
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.directions import fibonacci_directions, view_directions
from core.lab.baselines.paper_filters import apart, choose, paper_filters
from core.lab.baselines.strategy import Prepared
from core.placement.candidates import upright
from core.placement.filters import overlapping
from core.placement.objective import FACING_VIEW
from tests.core.lab.baselines.assets import asset
from tests.core.shapes import box, grid, join, moved

RNG_SEEDS = range(3)


def around(count: int, radius: float = 15.0, size: tuple[float, float, float] = (4, 1, 0.5)) -> Boxes:
    """Boxes spread evenly over a ball."""
    direction = fibonacci_directions(count)
    return Boxes(radius * direction, upright(direction), np.tile(size, (count, 1)))


def on(prepared: Prepared, *centers: tuple[float, float, float]) -> Boxes:
    """Boxes that face +Z."""
    size = (4.0, 4.0 * prepared.artwork.aspect, 0.5)
    return Boxes(np.array(centers), np.tile(np.eye(3), (len(centers), 1, 1)), np.tile(size, (len(centers), 1)))


def left(prepared: Prepared, boxes: Boxes) -> list[list[float]]:
    aligned = np.ones(len(boxes), dtype=bool)
    chosen = paper_filters(prepared, boxes, aligned, len(boxes), np.random.default_rng(0))
    return sorted(np.round(chosen.center, 6).tolist())


def dropped_because(prepared: Prepared, boxes: Boxes, aligned: bool = True) -> str:
    with pytest.raises(MeshmarkError) as refusal:
        paper_filters(prepared, boxes, np.full(len(boxes), aligned), 4, np.random.default_rng(0))
    assert refusal.value.code is ErrorCode.NO_PLACEMENT
    return refusal.value.message


@pytest.mark.parametrize("seed", RNG_SEEDS)
def test_boxes_that_are_kept_do_not_overlap_and_no_more_would_fit(seed: int) -> None:
    boxes = around(300)
    kept = apart(boxes, np.random.default_rng(seed))
    hit = np.array([overlapping(boxes, one) for one in kept])
    assert hit[:, kept].sum() == len(kept)
    assert hit.any(axis=0).all()


@pytest.mark.parametrize("seed", RNG_SEEDS)
def test_every_octant_gets_a_mark_first(seed: int) -> None:
    boxes = around(200)
    first = boxes.center[choose(boxes, 8, np.random.default_rng(seed))]
    assert len({tuple(side) for side in (first > 0).tolist()}) == 8


@pytest.mark.parametrize("seed", RNG_SEEDS)
def test_every_view_gets_a_mark_next(seed: int) -> None:
    boxes = around(200)
    chosen = choose(boxes, 32, np.random.default_rng(seed))
    assert len(set(chosen.tolist())) == 32
    faced = boxes.axes[chosen, 2] @ view_directions()[0].T >= FACING_VIEW
    assert faced.any(axis=0).all()


def test_more_than_the_rules_give_are_spread_out() -> None:
    boxes = around(400)
    chosen = choose(boxes, 40, np.random.default_rng(0))
    apart = np.linalg.norm(boxes.center[chosen[24:]][:, None] - boxes.center[chosen][None], axis=2)
    assert np.sort(apart, axis=1)[:, 1].min() > 3


def test_there_are_never_more_than_there_are_boxes() -> None:
    assert sorted(choose(around(5), 16, np.random.default_rng(0)).tolist()) == list(range(5))


def test_a_box_in_front_of_which_another_part_stands_is_dropped() -> None:
    facing_plates = asset(join(box(30, 20, 1), moved(box(10, 10, 1), -10, 0, 5)))
    middle = facing_plates.surface.positions[:, 2].min() + 1
    assert left(facing_plates, on(facing_plates, (-10, 0, middle), (10, 0, middle))) == [[10, 0, middle]]
    assert "in front" in dropped_because(facing_plates, on(facing_plates, (-10, 0, middle)))


def test_a_box_on_rough_ground_is_dropped() -> None:
    smooth, folded = grid(15, 20, 30, 40), grid(15, 20, 30, 40)
    folded.positions[:, 2] = 0.6 * (np.round(folded.positions[:, 0] * 2) % 2)
    half = asset(join(moved(smooth, -7.5, 0, 0), moved(folded, 7.5, 0, 0)))
    low = half.surface.positions[:, 2].min()
    assert "rough" in dropped_because(half, on(half, (7.5, 0, low + 0.3)))
    assert len(left(half, on(half, (-7.5, 0, low)))) == 1


def test_a_box_on_a_salient_part_is_dropped() -> None:
    plate = asset(grid(30, 20, 30, 20))
    points = np.random.default_rng(0).uniform([-15, -10, 0], [15, 10, 0], (20_000, 3))
    right = (points[:, 0] > 0).astype(np.float64)
    plate.saliency = Saliency(
        points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), right, 0.5, np.zeros(len(points), dtype=np.int64)
    )
    assert left(plate, on(plate, (-8, 0, 0), (8, 0, 0))) == [[-8, 0, 0]]
    assert "salient" in dropped_because(plate, on(plate, (8, 0, 0)))


def test_nothing_well_aligned_is_said_so() -> None:
    block = asset(box(30, 20, 10))
    assert "bends away" in dropped_because(block, on(block, (0, 0, 5)), aligned=False)
