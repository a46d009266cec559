"""An explanation tells of every box of a placement, and changes nothing about it."""

import json
import re
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from core.choices import Evaluate
from core.errors import ErrorCode
from core.explain.explain import Explanation, explain
from core.explain.layers import layers, model
from core.explain.page import TERMS, TITLES, explanation_page, write_explanation
from core.gltf.document import Document
from core.lab.plain import Mesh, plain_glb
from core.parameters import Parameters
from core.pipeline import watermark
from core.placement.rejection import REASONS, Stage
from tests.core.placement.shapes import cuboid, join
from tests.validator import error_counts

ASKED = Parameters(text="SAMPLE", count=3, evaluate=Evaluate.NONE)


@cache
def asset() -> bytes:
    """Two bars that cross: places over their edges are dropped."""
    shape = join(cuboid(30, 5, 5), cuboid(5, 16, 5))
    return plain_glb(Mesh(shape.positions, shape.faces))


@cache
def explained() -> Explanation:
    return explain(asset(), ASKED)


def test_the_marks_that_are_explained_are_those_of_the_same_request() -> None:
    report = watermark(asset(), ASKED, preview=False).report
    found, marks = ([mark["center"] for mark in each] for each in (explained().facts["marks"], report["watermarks"]))
    np.testing.assert_allclose(np.array(found), np.array(marks), atol=1e-6)
    assert report["embossing"]["refused"] == {}
    assert explained().facts["refused"] == []


def test_a_job_that_asks_publishes_the_same() -> None:
    published: dict[str, bytes] = {}
    watermark(asset(), ASKED.model_copy(update={"explain": True}), preview=False, publish=published.__setitem__)
    assert json.loads(published["explanation"]) == json.loads(json.dumps(explained().facts))
    assert published["layers"] == model(explained(), layers(explained()))


def test_every_box_is_left_or_dropped_by_each_filter_for_a_reason() -> None:
    trace = explained().trace
    for before, stage in pairwise(Stage):
        if list(Stage).index(stage) > list(Stage).index(Stage.DISTINCT):
            assert len(trace.left(before)) == len(trace.left(stage)) + len(trace.dropped(stage))
            assert stage in REASONS
    assert len(trace.left(Stage.CANDIDATES)) > len(trace.left(Stage.SEEN)) > len(explained().marks)
    assert len(trace.dropped(Stage.COVERED))
    assert [one["left"] for one in explained().facts["stages"]] == [len(trace.left(stage)) for stage in Stage]


def test_each_mark_adds_more_than_it_costs() -> None:
    for mark in explained().facts["marks"]:
        assert mark["covers"] > sum(mark["costs"].values()) + mark["beside_others"]
        assert mark["costs"].keys() <= TERMS.keys()
        assert mark["views"] > 0


def test_the_model_has_the_asset_and_a_node_for_each_layer_and_is_a_valid_file() -> None:
    shown = layers(explained())
    glb = model(explained(), shown)
    names = [node.get("name") for node in Document.from_glb(glb).json["nodes"]]
    assert set(names) >= {"asset", *(layer.name for layer in shown)}
    assert {"candidates", "fitted", "dropped-covered", "places", "marks"} <= set(names)
    assert not error_counts(glb)


def test_all_files_of_an_explanation_lie_in_its_folder(tmp_path: Path) -> None:
    written = write_explanation(explained(), "box.glb", tmp_path / "why")
    assert {path.name for path in written} == {path.name for path in (tmp_path / "why").iterdir()}
    assert json.loads((tmp_path / "why" / "explanation.json").read_text()) == json.loads(json.dumps(explained().facts))
    page = (tmp_path / "why" / "index.html").read_text()
    assert page.count("<article>") == len(explained().marks)
    assert not re.search(r"<script|https?://", page)
    assert (tmp_path / "why" / "mark-1.png").read_bytes().startswith(b"\x89PNG")


def test_where_nothing_finds_a_place_the_page_says_why() -> None:
    asked = {"text": "SAMPLE", "keep_out": [{"box": {"min": (-99, -99, -99), "max": (99, 99, 99)}}]}
    found = explain(asset(), Parameters.model_validate(asked))
    assert found.error is not None
    assert found.error.code is ErrorCode.NO_PLACEMENT
    page = explanation_page(found.facts, "<b>.glb", layers(found)[:0], {}, [])
    assert found.error.message in page
    assert "&lt;b&gt;.glb" in page
    assert "<b>" not in page


@pytest.mark.parametrize("stage", Stage)
def test_every_stage_has_its_words(stage: Stage) -> None:
    assert stage in TITLES
