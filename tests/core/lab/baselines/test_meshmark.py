import numpy as np
import pytest

from core.lab.attacks.letters import looks
from core.lab.baselines.meshmark import meshmark, meshmark_default, meshmark_discreet, meshmark_strong
from core.parameters import Parameters
from core.placement.finetune import ADAM, alignment_loss
from tests.core.lab.baselines.assets import asset, raised, same, wanted
from tests.core.shapes import moved, sphere

BALL = asset(moved(sphere(2.5, 4), 7, 8, 9))


def test_marks_are_read_back_in_the_frame_of_the_original() -> None:
    marked = meshmark(BALL, wanted(3), np.random.default_rng(0))
    assert len(marked.boxes) == 3
    assert marked.boxes.size[:, 0] == pytest.approx(4.0)
    assert marked.relief == pytest.approx(0.05)
    assert (alignment_loss(marked.boxes, BALL.index) < ADAM.threshold).all()
    tops, distance = raised(BALL, marked)
    assert distance == pytest.approx(0.05, rel=0.01)
    nearest = np.linalg.norm(tops[:, None] - marked.boxes.center[None], axis=2).min(axis=1)
    assert nearest.max() < 2.2


def test_the_default_product_is_asked_for_a_text_and_a_number_of_marks_only() -> None:
    asked = wanted(2).model_copy(update={"color": "none", "size": 2.0})
    marked = meshmark_default(BALL, asked, np.random.default_rng(0))
    same_request = Parameters(text=asked.text, count=2, seed=asked.seed)
    assert same(marked.mesh, meshmark(BALL, same_request, np.random.default_rng(0)).mesh)
    assert len(marked.boxes) == 2
    assert marked.boxes.size[0, 0] != pytest.approx(2.0)


def test_the_product_at_other_strengths_has_marks_of_their_sizes() -> None:
    widths = [
        method(BALL, wanted(4).model_copy(update={"seed": 2}), np.random.default_rng(2)).boxes.size[:, 0]
        for method in (meshmark_discreet, meshmark_default, meshmark_strong)
    ]
    assert [len(each) for each in widths] == [4, 4, 4]
    assert widths[0].mean() < widths[1].mean() < widths[2].mean()


def test_the_file_that_a_user_gets_comes_with_the_plain_mesh() -> None:
    marked = meshmark(BALL, wanted(1).model_copy(update={"color": "#d02020"}), np.random.default_rng(0))
    assert marked.delivered is not None
    assert len(marked.delivered.surface.faces) == len(marked.mesh.faces)
    look = looks(marked.delivered)
    assert len(np.unique(look)) == 2, "of the ground and of the letters"


def test_the_parameters_seed_decides_and_no_other() -> None:
    first, again = (meshmark(BALL, wanted(2), np.random.default_rng(seed)).mesh for seed in (0, 1))
    assert same(first, again)
