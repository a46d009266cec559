"""The engine as its callers use it: bytes in, bytes and a report out."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from core.choices import Evaluate, Mode, Preset, Profile, Wrap
from core.errors import ErrorCode, MeshmarkError
from core.formats.format import Format
from core.gltf.colors import hex_linear
from core.gltf.document import Document
from core.gltf.prune import unreferenced_bytes
from core.gltf.scene import scene_of
from core.labels.profiles import Label
from core.notices import NoticeCode
from core.parameters import AUTO_COLORS, Parameters
from core.pipeline import STAGES, Result, watermark
from core.report import Report
from tests.core.artwork.fontsmith import SQUARE, make_font
from tests.core.gltf.edited import colors_of_corners
from tests.core.gltf.ktx2_samples import UASTC
from tests.core.rendering.glb import CORNERS, CUBE_FACES, GlbWriter, plain
from tests.validator import error_counts

SPOT = Path(__file__).parents[1] / "data" / "spot.glb"
MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", "../shared/meshes"))
UNREAD = (ErrorCode.UNSUPPORTED_FORMAT, ErrorCode.UNSUPPORTED_FEATURE)
FEW = Parameters(text="watermark", count=3, evaluate=Evaluate.GEOMETRY)
UNMEASURED = FEW.model_copy(update={"evaluate": Evaluate.NONE})


@pytest.fixture(scope="module")
def spot() -> Result:
    return watermark(SPOT.read_bytes(), FEW)


def test_the_result_is_a_valid_glb_with_watermarks_in_it(spot: Result) -> None:
    assert not error_counts(spot.model)
    assert spot.file.format is Format.GLB
    assert spot.report["model"]["format"] == "glb"
    assert len(spot.report["watermarks"]) == 3
    assert spot.report["model"]["faces"] > spot.report["asset"]["faces"]


def test_the_asset_stays_what_it_was_but_for_the_letters(spot: Result) -> None:
    asset, model, utility = spot.report["asset"], spot.report["model"], spot.report["metrics"]["asset_utility"]
    assert asset["watertight"] is model["watertight"] is True
    assert asset["components"] == model["components"] == 1
    assert utility["ipe"] == 0
    assert utility["lce"] < 1e-3, "of letters that are round on top"
    before, after = Document.from_glb(SPOT.read_bytes()), Document.from_glb(spot.model)
    assert unreferenced_bytes(after) == 0
    for key in ("images", "textures", "samplers", "nodes", "scenes"):
        assert after.json[key] == before.json[key]
    assert after.json["materials"][: len(before.json["materials"])] == before.json["materials"]


def test_the_report_says_where_every_watermark_is(spot: Result) -> None:
    surface = scene_of(SPOT.read_bytes()).surface
    units = spot.report["units"]
    for mark in spot.report["watermarks"]:
        right, up, normal = (np.array(mark[name]) for name in ("right", "up", "normal"))
        assert np.allclose(np.cross(right, up), normal, atol=1e-6)
        normalised = (np.array(mark["center"]) - units["offset"]) * units["scale"]
        assert np.linalg.norm(surface.positions - normalised, axis=1).min() < 1.5
        assert mark["relief"] == pytest.approx(0.158 * mark["size"][1])
        assert mark["text"] == "watermark"
        assert mark["placement_score"] == pytest.approx(1.0, abs=0.02)
    json.dumps(spot.report, allow_nan=False)


def test_the_report_has_every_section_of_its_schema(spot: Result) -> None:
    assert spot.report["schema"] == "meshmark.report/1"
    assert {"asset", "model", "parameters", "seed", "engine", "units", "watermarks", "metrics", "timings"} <= set(
        spot.report
    )
    assert list(spot.report["timings"]) == list(STAGES)
    assert list(spot.report["memory"]) == list(STAGES)
    assert list(spot.report["memory"].values()) == sorted(spot.report["memory"].values())
    assert spot.report["memory"]["reading"] > 2**20
    assert spot.report["parameters"]["count"] == 3
    assert spot.report["warnings"] == []


@pytest.mark.parametrize("evaluate", [Evaluate.GEOMETRY, Evaluate.NONE])
def test_a_report_is_read_as_it_was_written(spot: Result, evaluate: Evaluate) -> None:
    report = spot.report if evaluate is FEW.evaluate else watermark(SPOT.read_bytes(), UNMEASURED, preview=False).report
    again = Report.model_validate_json(json.dumps(report))
    assert json.dumps(again.model_dump(mode="json")) == json.dumps(report)
    assert len(again.watermarks) == again.embossing.verified == 3
    assert (again.metrics is None) == (evaluate is Evaluate.NONE)
    later = report | {"author": "somebody", "engine": report["engine"] | {"commit": "0f8ebd3"}}
    assert Report.model_validate_json(json.dumps(later), extra="ignore") == again


def test_there_is_a_preview_of_eight_views(spot: Result) -> None:
    assert spot.preview is not None
    assert spot.preview.startswith(b"\x89PNG")


def test_a_turntable_and_its_poster_are_published_where_they_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("core.measuring.PICTURE_SIZE", 64)  # fifty pictures
    published: dict[str, bytes] = {}
    asked = Parameters(label=Label.CALIFORNIA, metadata_only=True, turntable=True)
    result = watermark(SPOT.read_bytes(), asked, preview=False, publish=published.__setitem__)
    assert (result.turntable, result.poster) == (published["turntable"], published["poster"])
    assert published["turntable"][:4] == published["poster"][:4] == b"RIFF"
    assert "preview" not in published


def test_the_same_request_gives_the_same_bytes_and_another_seed_gives_others(spot: Result) -> None:
    assert watermark(SPOT.read_bytes(), UNMEASURED, preview=False).model == spot.model
    assert watermark(SPOT.read_bytes(), UNMEASURED.model_copy(update={"seed": 1}), preview=False).model != spot.model


def test_progress_only_grows_and_names_the_stages_in_order() -> None:
    seen: list[tuple[str, float]] = []
    watermark(SPOT.read_bytes(), FEW, preview=False, progress=lambda stage, share: seen.append((stage, share)))
    shares = [share for _, share in seen]
    assert shares == sorted(shares)
    assert shares[0] >= 0
    assert shares[-1] <= 1
    assert list(dict.fromkeys(stage for stage, _ in seen)) == list(STAGES)


def test_the_model_is_published_before_it_is_measured() -> None:
    events: list[str] = []
    reports: list[dict[str, Any]] = []

    def publish(name: str, data: bytes) -> None:
        events.append(name)
        if name == "report":
            reports.append(json.loads(data))

    watermark(SPOT.read_bytes(), FEW, progress=lambda stage, _: events.append(stage), publish=publish)
    order = list(dict.fromkeys(events))
    assert order[order.index("writing") :] == [
        *("writing", "model", "plan", "reporting", "report", "rendering", "preview", "evaluating"),
    ]
    # What stands should the measurement not end: everything but the metrics, and why they are missing.
    assert len(reports[0]["watermarks"]) == 3
    metrics = reports[0]["metrics"]
    assert set(metrics["missing"]) == set(metrics["watermark_quality"]) | set(metrics["asset_utility"])
    assert metrics["missing"]["ray"]["code"] == "not_measured"


def test_a_full_report_has_all_eight_metrics_of_the_paper_and_what_each_of_them_took() -> None:
    asked = Parameters(text="watermark", count=6, color="#d02020")
    report = watermark(SPOT.read_bytes(), asked, preview=False).report
    metrics = report["metrics"]
    quality, utility = metrics["watermark_quality"], metrics["asset_utility"]
    assert all(value is not None for value in (quality | utility).values())
    assert metrics["missing"] == {}
    assert 0.3 < quality["ocr"] <= 1
    assert quality["ocr_exact"] <= quality["ocr_ge_0.8"] <= 1
    views = metrics["views"]
    assert len(views) == 24
    assert np.mean([view["ocr"] for view in views]) == pytest.approx(quality["ocr"], abs=1e-3)
    np.testing.assert_allclose(np.linalg.norm([view["direction"] for view in views], axis=1), 1, atol=1e-5)
    assert 0.5 < utility["ss"] < 1
    assert utility["se"] <= 1
    assert metrics["semantics"]
    assert list(metrics["seconds"]) == [
        *("placement", "visibility", "prominence", "label height", "artwork", "shape"),
        *("curvature", "saliency", "readability", "semantics"),
    ]
    assert all(0 <= mark["saliency"] <= 1 for mark in report["watermarks"])


def test_letters_with_a_colour_have_no_primitive_and_no_material_of_their_own() -> None:
    result = watermark(SPOT.read_bytes(), UNMEASURED.model_copy(update={"color": "#d02020"}), preview=False)
    before, document = Document.from_glb(SPOT.read_bytes()), Document.from_glb(result.model)
    assert len(document.json["meshes"][0]["primitives"]) == 1
    assert document.json["materials"] == before.json["materials"]
    assert {mark["colored_by"] for mark in result.report["watermarks"]} == {"texel"}
    assert all(mark["color_error"] < 1 for mark in result.report["watermarks"])
    assert not error_counts(result.model)
    scene = scene_of(result.model)
    shown = colors_of_corners(scene)
    red = np.abs(shown - hex_linear("#d02020")).max(axis=(1, 2)) < 0.01
    assert 0.0005 < scene.surface.areas[red].sum() / scene.surface.areas.sum() < 0.1, "letters, and nothing but"


def test_letters_of_chosen_colours_are_the_same_every_time() -> None:
    first, second = (watermark(SPOT.read_bytes(), UNMEASURED, preview=False) for _ in range(2))
    assert first.model == second.model
    assert first.report["parameters"]["color"] == "auto"
    assert all(mark["color"] in AUTO_COLORS and mark["contrast"] > 30 for mark in first.report["watermarks"])


def test_letters_that_no_light_would_show_get_a_colour_by_themselves() -> None:
    """Two cubes, one of them unlit: its letters are dark and unlit, those of the other have its own material."""
    writer = GlbWriter()
    writer.json["extensionsUsed"] = ["KHR_materials_unlit"]
    for place in (0.0, 5.0):
        unlit: dict[str, Any] = {"extensions": {"KHR_materials_unlit": {}}} if place else {}
        writer.mesh(CORNERS, CUBE_FACES, material=plain((0.8, 0.7, 0.6, 1), **unlit), translation=[place, 0, 0])
    result = watermark(writer.bytes(), UNMEASURED.model_copy(update={"count": 8, "color": "none"}), preview=False)
    colors = [(mark["color"], mark["center"][0] > 2.5) for mark in result.report["watermarks"]]
    assert {color is not None for color, is_unlit in colors if is_unlit} == {True}
    assert {color for color, is_unlit in colors if not is_unlit} == {None}
    assert {mark["colored_by"] for mark in result.report["watermarks"]} == {None, "vertex_colors"}
    document = Document.from_glb(result.model)
    assert len(document.json["materials"]) == 2
    lit, unlit = (mesh["primitives"][0]["attributes"] for mesh in document.json["meshes"])
    assert "COLOR_0" not in lit
    assert colors_of_corners(scene_of(result.model)).min() < 0.1
    assert "COLOR_0" in unlit
    assert not error_counts(result.model)


@pytest.mark.parametrize(("image", "codes"), [(UASTC, []), (UASTC[:99], ["texture_not_decoded"])])
def test_a_texture_that_cannot_be_decoded_is_warned_of(image: bytes, codes: list[str]) -> None:
    writer = GlbWriter()
    writer.json |= {name: ["KHR_texture_basisu"] for name in ("extensionsUsed", "extensionsRequired")}
    source = writer.add("images", {"bufferView": writer.view(image), "mimeType": "image/ktx2"})
    texture = writer.add("textures", {"extensions": {"KHR_texture_basisu": {"source": source}}})
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}}
    uv = {"TEXCOORD_0": np.abs(CORNERS[:, :2]) / 2}
    glb = writer.mesh(CORNERS, CUBE_FACES, uv, material).bytes()
    result = watermark(glb, UNMEASURED.model_copy(update={"count": 1}), preview=False)
    assert [warning["code"] for warning in result.report["warnings"]] == codes


def test_sunken_letters_take_material_away_and_raised_ones_add_it(spot: Result) -> None:
    def volume(glb: bytes) -> float:
        surface = scene_of(glb).surface
        world = surface.to_world(surface.positions)
        return float(trimesh.Trimesh(world, surface.faces, process=False).volume)

    plain = volume(SPOT.read_bytes())
    sunken = UNMEASURED.model_copy(update={"mode": Mode.DEBOSS})
    assert volume(spot.model) > plain
    assert volume(watermark(SPOT.read_bytes(), sunken, preview=False).model) < plain


def _unseen_at_first(monkeypatch: pytest.MonkeyPatch, *verdicts: list[bool]) -> None:
    """The written file is judged so, one time after the other, and found good from then on."""
    left = list(verdicts)

    def judged(_edit: object, count: int, *_: object) -> NDArray[np.bool_]:
        return np.array(left.pop(0) if left else [True] * count)

    monkeypatch.setattr("core.embossing.drawn.drawn_marks", judged)


@pytest.mark.parametrize("mode", list(Mode))
def test_letters_of_a_soft_profile_leave_all_else_of_a_real_asset_as_it_was(mode: Mode) -> None:
    result = watermark(SPOT.read_bytes(), FEW.model_copy(update={"profile": Profile.SOFT, "mode": mode}))
    assert not error_counts(result.model)
    asset, model, metrics = result.report["asset"], result.report["model"], result.report["metrics"]
    assert asset["watertight"] is model["watertight"] is True
    assert model["components"] == 1
    assert len(result.report["watermarks"]) == 3
    assert {mark["cut"] for mark in result.report["watermarks"]} == {"delaunay"}
    assert 1000 < (model["faces"] - asset["faces"]) / 3 < 6000
    assert metrics["watermark_quality"]["match"] > 0.9
    assert metrics["asset_utility"]["ipe"] == 0
    assert unreferenced_bytes(Document.from_glb(result.model)) == 0


def test_a_mark_that_no_viewer_draws_is_taken_out_before_anybody_gets_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, published = Parameters(text="hi", count=3, evaluate=Evaluate.NONE), []
    _unseen_at_first(monkeypatch, [True, False, True])
    data = GlbWriter().mesh(CORNERS, CUBE_FACES).bytes()
    result = watermark(data, asked, preview=False, publish=lambda name, _: published.append(name))
    assert published == ["model", "plan", "report"]
    assert [mark["drawn"] for mark in result.report["watermarks"]] == [True, True]
    assert result.report["embossing"] == {"tried": 3, "verified": 2, "refused": {"undrawn": 1}}
    _unseen_at_first(monkeypatch)
    whole = watermark(data, asked, preview=False).report["watermarks"]
    kept = [mark["center"] for mark in result.report["watermarks"]]
    assert kept == [whole[0]["center"], whole[2]["center"]]


def test_where_no_viewer_draws_any_mark_nothing_is_published(monkeypatch: pytest.MonkeyPatch) -> None:
    _unseen_at_first(monkeypatch, [False, False])
    published: list[str] = []
    with pytest.raises(MeshmarkError, match="no viewer would draw them") as caught:
        watermark(
            GlbWriter().mesh(CORNERS, CUBE_FACES).bytes(),
            Parameters(text="hi", count=2, evaluate=Evaluate.NONE),
            preview=False,
            publish=lambda name, _: published.append(name),
        )
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert not published


@pytest.mark.parametrize("preset", list(Preset))
def test_every_preset_marks_the_asset(preset: Preset) -> None:
    asked = Parameters(text="watermark", preset=preset, evaluate=Evaluate.GEOMETRY)
    result = watermark(SPOT.read_bytes(), asked, preview=False)
    assert 1 <= len(result.report["watermarks"]) <= result.report["parameters"]["count"]
    assert result.report["metrics"]["asset_utility"]["ipe"] == 0


def test_the_report_names_the_fonts_and_warns_where_the_one_that_was_sent_did_not_do() -> None:
    parameters = Parameters(text="AI\n\u751f\u6210", count=1, evaluate=Evaluate.NONE)
    font = make_font({"A": [SQUARE], "I": [SQUARE]})
    plain, own = (watermark(SPOT.read_bytes(), parameters, font=sent, preview=False) for sent in (None, font))
    names = [[(font["name"], font["thickened"]) for font in result.report["fonts"]] for result in (plain, own)]
    assert names == [[(first, 0.0), ("Noto Sans CJK SC Bold", 0.0)] for first in ("DejaVu Sans Bold", "Test")]
    warned = [[notice["code"] for notice in result.report["warnings"]] for result in (plain, own)]
    assert [NoticeCode.FONT_SUBSTITUTED in codes for codes in warned] == [False, True]


def test_what_is_asked_for_is_what_is_done() -> None:
    asked = Parameters(text="Hi", size=2.5, size_exact=True, relief=0.3, count=2, evaluate=Evaluate.NONE)
    report = watermark(SPOT.read_bytes(), asked, preview=False).report
    scale = report["units"]["scale"]
    assert len(report["watermarks"]) == 2
    for mark in report["watermarks"]:
        assert mark["size"][0] * scale == pytest.approx(2.5)
        assert mark["relief"] * scale == pytest.approx(0.3)
    assert report["metrics"] is None


@pytest.mark.parametrize(
    "text", ["i", "\u00a9", "JB", "watermark", "Property of Example Studios, 2026. Do not copy it."]
)
def test_letters_stand_out_by_the_same_share_of_their_height_however_long_the_text(text: str) -> None:
    asked = Parameters(text=text, wrap=Wrap.NONE, count=1, evaluate=Evaluate.NONE)
    report = watermark(SPOT.read_bytes(), asked, preview=False).report
    (mark,) = report["watermarks"]
    assert mark["relief"] / mark["size"][1] == pytest.approx(0.158)
    assert report["warnings"] == []


@pytest.mark.parametrize(("color", "warned"), [("none", ["small_text"]), ("#d02020", [])])
def test_text_too_low_to_be_read_is_warned_of_however_wide_it_is(color: str, warned: list[str]) -> None:
    asked = Parameters(text="m" * 64, size=8.0, count=1, color=color, evaluate=Evaluate.NONE)
    low = watermark(SPOT.read_bytes(), asked, preview=False).report
    assert [warning["code"] for warning in low["warnings"]] == ["small_text"]
    assert "larger `size`" in low["warnings"][0]["remedy"]
    word = Parameters(text="watermark", size=1.8, count=1, color=color, evaluate=Evaluate.NONE)
    report = watermark(SPOT.read_bytes(), word, preview=False).report
    assert [warning["code"] for warning in report["warnings"]] == warned


@pytest.mark.parametrize("file_type", ["obj", "stl", "stl_ascii", "ply", "off"])
def test_every_other_format_comes_back_as_a_valid_glb(file_type: str) -> None:
    cube = trimesh.creation.box(extents=(2, 2, 2))
    exported = cube.export(file_type=file_type)
    result = watermark(exported.encode() if isinstance(exported, str) else exported, FEW, preview=False)
    assert result.report["asset"]["format"] == file_type.removesuffix("_ascii")
    assert result.report["asset"]["watertight"] is result.report["model"]["watertight"] is True
    assert not error_counts(result.model)


def test_a_mesh_with_no_room_for_a_word_is_an_error_and_publishes_nothing() -> None:
    needle = trimesh.creation.cylinder(radius=0.004, height=2.0, sections=6)
    published: list[str] = []
    with pytest.raises(MeshmarkError) as caught:
        watermark(needle.export(file_type="ply"), FEW, publish=lambda name, _: published.append(name))
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert caught.value.remedy
    assert published == []


def test_without_a_renderer_the_asset_is_delivered_and_the_report_says_why_there_is_no_preview(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unavailable(_: object) -> bytes:
        raise MeshmarkError(ErrorCode.RENDERING_UNAVAILABLE, "No EGL here.", "Install it.")

    monkeypatch.setattr("core.measuring.contact_sheet", unavailable)
    result = watermark(SPOT.read_bytes(), FEW.model_copy(update={"evaluate": Evaluate.FULL}))
    assert result.preview is None
    reason = {"code": "rendering_unavailable", "message": "No EGL here.", "remedy": "Install it."}
    assert result.report["warnings"] == [reason]
    metrics = result.report["metrics"]
    assert metrics["missing"] == dict.fromkeys(("ocr", "ocr_ge_0.8", "ocr_exact", "ss"), reason)
    assert metrics["watermark_quality"]["ocr"] is None
    assert metrics["watermark_quality"]["ray"] > 0


def test_a_measurement_that_fails_is_null_with_its_reason_and_the_others_are_there(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> float:
        raise ZeroDivisionError("secret detail")

    monkeypatch.setattr("core.metrics.measure.ipe", broken)
    flat = FEW.model_copy(update={"profile": Profile.FLAT})
    metrics = watermark(SPOT.read_bytes(), flat, preview=False).report["metrics"]
    assert metrics["asset_utility"]["ipe"] is None
    assert metrics["missing"]["ipe"]["code"] == "evaluation_failed"
    assert "secret" not in metrics["missing"]["ipe"]["message"]
    assert "secret detail" in caplog.text, "the log holds the details"
    assert capfd.readouterr() == ("", ""), "and nothing is printed"
    assert metrics["asset_utility"]["lce"] < 1e-9


@pytest.mark.parametrize(
    "path", sorted(p for p in MESHES.glob("*") if p.suffix not in (".md", ".csv")), ids=lambda path: path.name
)
@pytest.mark.parametrize(("profile", "uneven"), [(Profile.SOFT, 0.25), (Profile.FLAT, 0.04)])
def test_a_real_asset_is_marked_without_changing_its_topology_or_is_refused_by_its_format(
    path: Path, profile: Profile, uneven: float
) -> None:
    data = path.read_bytes()
    try:
        result = watermark(data, FEW.model_copy(update={"profile": profile}), preview=False)
    except MeshmarkError as error:
        assert error.code in UNREAD  # noqa: PT017 - which files, the tests of the gate say
        return
    asset, model = result.report["asset"], result.report["model"]
    assert 1 <= len(result.report["watermarks"]) <= 3
    for fact in ("watertight", "components", "boundary_edges", "nonmanifold_edges"):
        assert asset[fact] == model[fact], fact
    # The tops follow the surface: their height above it deviates by a share of the relief at most.
    relief = min(mark["relief"] for mark in result.report["watermarks"]) * result.report["units"]["scale"]
    assert np.sqrt(result.report["metrics"]["asset_utility"]["lce"]) < uneven * relief
    known = error_counts(data) if asset["format"] == "glb" else {}
    assert set(error_counts(result.model)) <= set(known)
