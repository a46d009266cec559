"""All metrics of a pair of assets, and why one is missing."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.artwork.artwork import Artwork
from core.artwork.layouts import Layouts
from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.metrics.measure import READABILITY, Pair, Subject, measure
from core.metrics.measurement import HIGHER_IS_BETTER, UNITS, Measurement
from core.rendering.pictures import Views
from core.reporting import metrics_of
from tests.core.metrics.test_ray import on_all_sides
from tests.core.placement.shapes import cuboid, index_of, join, moved

BLOCK = cuboid(10, 10, 10)


def pair(watermarked: Surface, boxes: Boxes, text: str = "watermark") -> Pair:
    no_pictures = MeshmarkError(ErrorCode.RENDERING_UNAVAILABLE, "No EGL here.", "Install it.")
    return Pair(
        Subject(BLOCK, index_of(BLOCK), no_pictures),
        Subject(watermarked, index_of(watermarked), no_pictures),
        boxes,
        np.full(len(boxes), 0.2),
        text,
    )


def geometry(watermarked: Surface, boxes: Boxes) -> Measurement:
    return measure(pair(watermarked, boxes), Evaluate.GEOMETRY)


def test_the_report_carries_every_metric_and_says_which_way_is_better() -> None:
    found = metrics_of(geometry(BLOCK, on_all_sides())).model_dump(mode="json")
    quality, utility = found["watermark_quality"], found["asset_utility"]
    assert list(quality) == [
        "wps",
        "wps_area",
        "ray",
        "ray_box",
        "coverage",
        "crop_survival",
        "prominence",
        "prominence_least",
        "label_height_share",
        "match",
        "ocr",
        "ocr_ge_0.8",
        "ocr_exact",
    ]
    assert list(utility) == ["smse", "smse_squared", "ipe", "lce", "lce_pooled", "se", "se_lee2005", "ss"]
    assert found["higher_is_better"].keys() == quality.keys() | utility.keys()
    assert set(UNITS) <= set(utility)
    assert {kind: list(names) for kind, names in HIGHER_IS_BETTER.items()} == {
        "watermark_quality": list(quality),
        "asset_utility": list(utility),
    }
    assert quality["wps"] == 0
    assert quality["wps_area"] == pytest.approx(1)
    assert quality["ray"] == quality["ray_box"] == 1
    assert utility["smse"] == pytest.approx(0, abs=1e-9)
    assert utility["ipe"] == utility["se"] == utility["se_lee2005"] == 0
    json.dumps(found, allow_nan=False)


def test_damage_shows_in_the_asset_utility() -> None:
    marked = join(BLOCK, moved(cuboid(1, 1, 0.1), shift=(0, 0, 6)))
    values = geometry(marked, on_all_sides()).values
    assert values["ipe"] == 1
    assert values["smse"] == pytest.approx((1 * 0.95 + 1 * 1.05 + 0.4 * 1) / 602.4, rel=0.2)


def test_whatever_is_missing_has_its_reason() -> None:
    found = geometry(BLOCK, on_all_sides())
    assert set(found.missing) == {name for name, value in found.values.items() if value is None}
    assert {name: reason.code for name, reason in found.missing.items()} == {
        "lce": "invalid_request",  # a block without letters has no tops
        "lce_pooled": "invalid_request",
        "match": "invalid_request",  # nobody knows the artwork
        "label_height_share": "invalid_request",
        **dict.fromkeys(("ocr", "ocr_ge_0.8", "ocr_exact", "ss"), "not_requested"),
    }


def test_without_pictures_everything_else_is_measured() -> None:
    found = measure(pair(BLOCK, on_all_sides()), Evaluate.FULL)
    assert {found.missing[name].code for name in ("ocr", "ss")} == {"rendering_unavailable"}
    assert found.values["ray"] == 1


def test_without_places_what_needs_none_is_measured() -> None:
    nowhere = on_all_sides()[np.array([], dtype=np.int64)]
    found = geometry(BLOCK, nowhere)
    assert found.values["ipe"] == 0
    assert {found.missing[name].code for name in ("wps", "ray", "lce_pooled", "se", "se_lee2005")} == {
        "invalid_request"
    }


def test_without_a_text_nothing_can_be_read() -> None:
    assert measure(pair(BLOCK, on_all_sides(), ""), Evaluate.FULL).missing["ocr"].code == "invalid_request"


def test_nothing_is_measured_where_nothing_was_asked_for() -> None:
    found = measure(pair(BLOCK, on_all_sides()), Evaluate.NONE)
    assert found.seconds == {}
    assert set(found.missing) == set(found.values)


def test_weights_that_cannot_be_read_are_done_without_and_the_report_warns(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("MESHMARK_MODELS", str(tmp_path / ("a name that is too long" * 20)))
    pictures = np.full((2, 64, 64, 3), 200, np.uint8)
    seen = Subject(BLOCK, index_of(BLOCK), Views(pictures, pictures))
    boxes = on_all_sides()
    found = measure(Pair(seen, seen, boxes, np.full(len(boxes), 0.2), ""), Evaluate.FULL)
    assert found.values["ss"] == pytest.approx(1)
    assert found.semantics == "hog-color-layout"
    (warning,) = found.warnings
    assert warning.code == "model_unavailable"
    assert "cannot be read" in warning.message


def test_a_text_that_the_recognition_cannot_read_has_no_ocr_and_its_letters_are_named() -> None:
    found = measure(pair(BLOCK, on_all_sides(), "ไทย 7"), Evaluate.FULL)
    assert found.values["ocr"] is found.values["ocr_exact"] is None
    assert {found.missing[name].code for name in READABILITY} == {"unreadable_script"}
    assert "ไ (U+0E44), ท (U+0E17), ย (U+0E22);" in found.missing["ocr"].message


def test_marks_without_a_text_have_no_ocr() -> None:
    found = measure(replace(pair(BLOCK, on_all_sides(), ""), layouts=Layouts((plate_artwork(),))), Evaluate.FULL)
    assert {found.missing[name].code for name in READABILITY} == {"no_text"}


def plate_artwork() -> Artwork:
    corners = np.array([[-0.5, -0.25], [0.5, -0.25], [0.5, 0.25], [-0.5, 0.25]])
    return Artwork(label="a plate", rings=(corners,), aspect=0.5, ink=1.0, line_height=0.5)
