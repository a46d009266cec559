"""`meshmark evaluate`: the metrics of any pair of files."""

import json
from pathlib import Path
from typing import cast

import pytest
import trimesh

from core.choices import Evaluate
from core.cli import main
from core.errors import MeshmarkError
from core.evaluate import evaluate, parse_watermarks
from core.geometry.spatial import SpatialIndex
from core.metrics.measure import Pair, measure
from core.metrics.measurement import Measurement
from core.parameters import Parameters
from core.pipeline import Result, watermark
from core.report import EvaluationReport

SPOT = Path(__file__).parents[1] / "data" / "spot.glb"
OF_ARTWORK = ("match", "label_height_share")  # only the job knows the outlines of the letters
PLATE = trimesh.creation.box(extents=(2, 2, 0.2))


@pytest.fixture(scope="module")
def marked() -> Result:
    asked = Parameters(text="watermark", count=3, evaluate=Evaluate.GEOMETRY)
    return watermark(SPOT.read_bytes(), asked, preview=False)


def test_a_pair_measures_as_it_did_in_the_job_that_made_it_save_for_the_artwork(marked: Result) -> None:
    places = parse_watermarks(json.dumps(marked.report).encode())
    again = evaluate(SPOT.read_bytes(), marked.model, places, level=Evaluate.GEOMETRY)
    before = marked.report["metrics"]
    for kind in ("watermark_quality", "asset_utility"):
        for name, value in before[kind].items():
            if name in OF_ARTWORK:
                continue
            expected = value if value is None else pytest.approx(value, rel=1e-6, abs=1e-12)
            assert again["metrics"][kind][name] == expected, name
    assert again["model"] == marked.report["model"]
    assert again["asset"] == marked.report["asset"]
    reasons = [again["metrics"]["missing"].pop(name) for name in OF_ARTWORK]
    assert {reason["code"] for reason in reasons} == {"invalid_request"}
    assert all("known only to the job" in reason["message"] for reason in reasons)
    assert again["metrics"]["missing"] == before["missing"]
    assert json.dumps(EvaluationReport.model_validate(again).model_dump(mode="json")) == json.dumps(again)


def test_a_text_in_lines_is_read_as_the_report_has_them(monkeypatch: pytest.MonkeyPatch) -> None:
    measured: list[Pair] = []

    def noted(pair: Pair, level: Evaluate) -> Measurement:
        measured.append(pair)
        return measure(pair, level)

    monkeypatch.setattr("core.evaluate.measure", noted)
    place = {"center": [0, 0, 0.1], "up": [0, 1, 0], "normal": [0, 0, 1], "size": [1.2, 0.6, 0.1], "relief": 0.1}
    marks = [place | {"text": "a b", "lines": lines} for lines in (["a b"], ["a", "b"], ["a b"])]
    plate = cast(bytes, PLATE.export(file_type="stl"))
    for text in ("", "other"):
        evaluate(plate, plate, parse_watermarks(json.dumps(marks).encode()), text, Evaluate.NONE)
    assert [pair.settings for pair in measured] == [("a b", "a\nb"), ()]


def test_files_of_other_tools_are_measured_with_places_from_a_list() -> None:
    """A slab stands where letters would: on the front of a plate, 0.1 high, written as STL and OBJ."""
    slab = trimesh.creation.box(extents=(1.0, 0.5, 0.1))
    slab.apply_translation((0, 0, 0.15))
    both = PLATE + slab
    place = {"center": [0, 0, 0.1], "up": [0, 2, 0], "normal": [0, 0, 1], "size": [1.2, 0.6, 0.1], "relief": 0.1}
    watermarks = parse_watermarks(json.dumps([place]).encode())
    before, after = cast(bytes, PLATE.export(file_type="stl")), cast(str, both.export(file_type="obj")).encode()
    report = evaluate(before, after, watermarks, level=Evaluate.GEOMETRY)
    metrics = report["metrics"]
    assert metrics["asset_utility"]["ipe"] == 1
    assert metrics["asset_utility"]["lce"] == pytest.approx(0, abs=1e-9)
    assert metrics["watermark_quality"]["wps_area"] == pytest.approx(1)
    assert metrics["watermark_quality"]["ray"] == pytest.approx(
        6 / 24
    )  # three of each turn are within 45 degrees of it
    assert report["asset"]["format"] == "stl"


def test_the_report_names_the_device_that_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    class Elsewhere(SpatialIndex):
        device = "cuda"

    monkeypatch.setattr("core.analysis.analyse.SpatialIndex", Elsewhere)
    plate = cast(bytes, PLATE.export(file_type="stl"))
    assert evaluate(plate, plate, [], level=Evaluate.NONE)["engine"]["device"] == "cuda"


@pytest.mark.parametrize(
    "content",
    [
        b"no json",
        b"3",
        b'[{"center": [0, 0, 0]}]',
        b'[{"center": [0,0,0], "up": [0,0,2], "normal": [0,0,1], "size": [1,1,1], "relief": 1}]',
        b'[{"center": [0,0,0], "up": [0,1,0], "normal": [0,0,1], "size": [1,0,1], "relief": 1}]',
        b'[{"center": [0,0,NaN], "up": [0,1,0], "normal": [0,0,1], "size": [1,1,1], "relief": 1}]',
    ],
)
def test_places_that_are_none_are_refused_with_what_is_wrong(content: bytes) -> None:
    with pytest.raises(MeshmarkError, match="invalid_parameters"):
        parse_watermarks(content)


def test_the_command_writes_the_report_and_prints_every_metric(
    marked: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, places, report = (tmp_path / name for name in ("model.glb", "places.json", "report.json"))
    model.write_bytes(marked.model)
    places.write_text(json.dumps(marked.report))
    arguments = ["evaluate", str(SPOT), str(model), "--watermarks", str(places), "--report", str(report)]
    assert main(arguments) == 0
    metrics = json.loads(report.read_text())["metrics"]
    assert set(metrics["missing"]) == set(OF_ARTWORK)
    printed = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert list(printed) == [*metrics["watermark_quality"], *metrics["asset_utility"]]
    assert float(printed["ocr"]) == pytest.approx(metrics["watermark_quality"]["ocr"], abs=1e-3)
