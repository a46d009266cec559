import numpy as np
import pytest

from core.choices import Mode
from core.errors import ErrorCode, MeshmarkError
from core.lab.baselines import STRATEGIES
from core.lab.baselines.strategy import Prepared, prepare, text_width
from core.lab.benchmark.options import OBJECTIVE_METHODS
from core.lab.plain import plain, plain_glb
from core.parameters import Parameters
from tests.core.lab.baselines.assets import asset, wanted
from tests.core.shapes import box, grid

# Variants of the product that are asked for a text only, or for another profile.
OURS = ("meshmark-default", "meshmark-discreet", "meshmark-strong", "meshmark-flat")


@pytest.fixture
def block() -> Prepared:
    return asset(box(30, 20, 10))


def test_boxes_stand_on_exactly_axis_aligned_sides(block: Prepared) -> None:
    boxes, loss = block.initial(4.0)
    assert np.isfinite(boxes.axes).all()
    assert np.isfinite(loss).all()
    assert {tuple(normal) for normal in np.round(boxes.axes[:, 2]).astype(int).tolist()} == {
        (sign * x, sign * y, sign * z) for sign in (-1, 1) for x, y, z in ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    }


def test_boxes_have_the_proportions_of_the_text_and_the_papers_thickness(block: Prepared) -> None:
    boxes, _ = block.initial(4.0)
    assert np.allclose(boxes.size, [4, 4 * block.artwork.aspect, 0.5])


def test_candidates_keep_the_papers_distance(block: Prepared) -> None:
    center = block.initial(4.0)[0].center
    apart = np.linalg.norm(center[:, None] - center[None], axis=2) + 10 * np.eye(len(center))
    assert apart.min() >= 1.0
    assert 100 < len(center) < 300


def test_the_fit_is_made_once_for_each_width(block: Prepared) -> None:
    assert block.fitted(4.0) is block.fitted(4.0)
    assert block.fitted(4.0) is not block.fitted(3.0)


def test_the_seed_decides_where_candidates_are() -> None:
    first, again, other = (asset(box(30, 20, 10), seed).initial(4.0)[0].center for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_without_a_size_the_text_is_as_wide_as_in_the_papers_preset() -> None:
    assert text_width(Parameters(text="mark").resolved()) == 5.5
    assert text_width(wanted(4, size=3.0)) == 3.0


@pytest.mark.parametrize("name", sorted(set(STRATEGIES) - {*OBJECTIVE_METHODS, *OURS}))
def test_sunken_letters_are_refused_by_the_baselines(block: Prepared, name: str) -> None:
    sunken = wanted(4).model_copy(update={"mode": Mode.DEBOSS})
    with pytest.raises(MeshmarkError) as refusal:
        STRATEGIES[name](block, sunken, np.random.default_rng(0))
    assert refusal.value.code is ErrorCode.INVALID_PARAMETERS


@pytest.mark.parametrize("name", ["li", "paper-no-filtering"])
def test_an_open_asset_is_refused_with_its_own_code(name: str) -> None:
    with pytest.raises(MeshmarkError) as refusal:
        STRATEGIES[name](asset(grid(30, 30, 2, 2)), wanted(4), np.random.default_rng(0))
    assert refusal.value.code is ErrorCode.NOT_MANIFOLD


@pytest.mark.parametrize("backs", [False, True])
def test_pictures_of_clay_show_the_backs_of_faces_where_the_file_does(backs: bool) -> None:
    assert prepare(plain_glb(plain(box(30, 20, 10)), double_sided=backs), "mark").double_sided == backs
