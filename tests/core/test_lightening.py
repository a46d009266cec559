"""The preview model, as callers of the engine get it."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from core import marking
from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.gltf.document import Document
from core.gltf.images import image_size
from core.gltf.scene import scene_of
from core.labels.profiles import Label
from core.lightening import lighten
from core.notices import NoticeCode
from core.parameters import Parameters
from core.pipeline import Result, watermark
from core.preview_model import PreviewModel
from core.report import Report
from core.stages import Asset, Candidates, Embossed, LightOutput, Output, Request, Run
from tests.residue import residue
from tests.validator import error_counts

SPOT = Path(__file__).parents[1] / "data" / "spot.glb"
LIGHT = PreviewModel(triangles=1500, texture=64)
WISH = Parameters(text="watermark", count=3, evaluate=Evaluate.GEOMETRY, preview_model=LIGHT, label=Label.CUSTOM)
UNMEASURED = WISH.model_copy(update={"evaluate": Evaluate.NONE})


def marked(parameters: Parameters) -> tuple[Result, dict[str, bytes]]:
    published: dict[str, bytes] = {}
    result = watermark(SPOT.read_bytes(), parameters, preview=False, publish=published.__setitem__)
    return result, published


@pytest.fixture(scope="module")
def beside() -> tuple[Result, dict[str, bytes]]:
    return marked(WISH)


def test_a_light_model_lies_beside_the_model_and_has_its_marks_and_label(
    beside: tuple[Result, dict[str, bytes]],
) -> None:
    result, published = beside
    light = published["preview_model"]
    assert light == result.preview_model
    assert published["model"] == result.model
    assert not error_counts(light)
    assert residue(light) == []
    facts, report = result.report["preview_model"], result.report
    assert facts["watermarks"] == [mark["id"] for mark in report["watermarks"]] == [0, 1, 2]
    assert facts["triangles_before"] == report["asset"]["faces"]
    assert facts["triangles"] <= 1500 < facts["faces"] < report["model"]["faces"]
    assert facts["faces"] == len(scene_of(light).surface.faces)
    assert facts["bytes"] == len(light)
    document = Document.from_glb(light)
    sizes = [image_size(data) for k in range(len(document.json["images"])) if (data := document.image(k)) is not None]
    assert [tuple(size) for size in facts["textures"]] == sizes == [(64, 64)]
    packets = [Document.from_glb(file).json["extensions"]["KHR_xmp_json_ld"] for file in (light, result.model)]
    assert packets[0] == packets[1]


def test_it_has_metrics_of_its_own_where_they_differ(beside: tuple[Result, dict[str, bytes]]) -> None:
    own, whole = beside[0].report["preview_model"]["metrics"], beside[0].report["metrics"]
    assert own["asset_utility"]["smse"] > whole["asset_utility"]["smse"] > 0
    assert own["watermark_quality"]["match"] > 0.9
    assert own["watermark_quality"]["coverage"] > 0.1
    assert own["watermark_quality"]["wps"] is None
    assert own["missing"]["wps"]["code"] == NoticeCode.NOT_MEASURED
    assert Report.model_validate_json(json.dumps(beside[0].report)).preview_model is not None


def test_alone_it_is_the_model_and_nothing_else_of_the_asset_is_published(
    beside: tuple[Result, dict[str, bytes]],
) -> None:
    alone = WISH.model_copy(update={"preview_model": LIGHT.model_copy(update={"alone": True})})
    result, published = marked(alone)
    assert result.model == published["model"] == beside[1]["preview_model"]
    assert result.preview_model is None
    assert set(published) == {"model", "plan", "report"}, "a plan has nothing of the shape"
    report = result.report
    assert report["model"]["sha256"] == report["preview_model"]["sha256"]
    assert report["model"]["faces"] == report["preview_model"]["faces"]
    assert report["preview_model"]["alone"]
    assert report["preview_model"]["metrics"] is None
    own = beside[0].report["preview_model"]["metrics"]["asset_utility"]
    assert report["metrics"]["asset_utility"]["smse"] == own["smse"]


@dataclass(frozen=True)
class Made:
    """What the stages before the preview model made of spot, for a request without one."""

    asset: Asset
    candidates: Candidates
    output: Output

    def lighten(self, wish: PreviewModel) -> tuple[LightOutput | None, Run, dict[str, bytes]]:
        published: dict[str, bytes] = {}
        request = Request(UNMEASURED.model_copy(update={"preview_model": wish}).resolved())
        run = Run(request, lambda _share: None, published.__setitem__)
        return lighten(self.asset, self.candidates.ground, self.output, run), run, published


@pytest.fixture(scope="module")
def made() -> Made:
    asked = UNMEASURED.model_copy(update={"preview_model": None})
    run = Run(Request(asked.resolved()), lambda _share: None, lambda _name, _data: None)
    asset = marking.read(SPOT.read_bytes(), run.request.budgets, run.request.parameters.format)
    candidates = marking.place(asset, marking.letter(run), run)
    return Made(
        asset, candidates, marking.write_model(asset, candidates.ground, marking.emboss(asset, candidates, run), run)
    )


def test_the_model_is_what_it_is_without_a_light_one(made: Made, beside: tuple[Result, dict[str, bytes]]) -> None:
    assert made.output.file.data == beside[0].model


def test_more_triangles_than_there_are_leave_the_shape_and_say_so(made: Made) -> None:
    light, run, published = made.lighten(PreviewModel(triangles=2_000_000))
    assert light is not None
    assert light.triangles == light.before == 5856
    assert [notice.code for notice in run.notices] == [NoticeCode.PREVIEW_MODEL_HEAVY]
    assert "all 5,856 triangles" in run.notices[0].message
    assert set(published) == {"preview_model"}


def test_without_a_mark_on_it_there_is_no_light_model(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    def none_fits(_asset: Asset, _ground: object, embossed: Embossed, _parameters: object) -> Embossed:
        return replace(embossed, marks={})

    monkeypatch.setattr("core.lightening.embossed_again", none_fits)
    light, run, published = made.lighten(LIGHT)
    assert light is None
    assert published == {}, "no unmarked file"
    assert [notice.code for notice in run.notices] == [NoticeCode.NO_PREVIEW_MODEL]
    assert "None of the 3 watermarks fits" in run.notices[0].message
    with pytest.raises(MeshmarkError) as refused:
        made.lighten(LIGHT.model_copy(update={"alone": True}))
    assert refused.value.code is ErrorCode.NO_PLACEMENT
