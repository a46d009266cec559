"""Marks of real files are read back, and where there are none nothing is."""

import base64
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from core.cli import main
from core.errors import ErrorCode, MeshmarkError
from core.gltf.document import Document
from core.gltf.scene import scene_of
from core.lab.attacks.attack import attack_file
from core.lab.plain import plain
from core.parameters import Parameters
from core.pipeline import watermark
from core.verify.verify import Verification, verify

SPOT = (Path(__file__).parents[2] / "data" / "spot.glb").read_bytes()


@cache
def marked(**asked: Any) -> tuple[bytes, list[dict[str, Any]]]:
    parameters = {"text": "watermark", "count": 2, "evaluate": "none", "declaration": {"creator": "me"}}
    result = watermark(SPOT, Parameters.model_validate(parameters | asked), preview=False)
    return result.model, result.report["watermarks"]


@cache
def verified(color: str) -> Verification:
    return verify(marked(color=color)[0], ["watermark", "another text"])


def centers(found: Verification) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([mark["center"] for mark in found.report["marks"]])


@pytest.mark.parametrize("color", ["auto", "none"])
def test_every_mark_is_read_where_it_stands(color: str) -> None:
    _, marks = marked(color=color)
    found = verified(color)
    assert found.report["found"] == ["watermark"]
    assert len(found.report["marks"]) == len(found.pictures) == len(marks)
    for mark in marks:
        away = np.linalg.norm(centers(found) - mark["center"], axis=1)
        read = found.report["marks"][int(away.argmin())]
        assert away.min() < mark["size"][0] / 4
        assert np.dot(read["right"], mark["right"]) > 0.9
        assert np.dot(read["normal"], mark["normal"]) > 0.7
        assert read["length"] == pytest.approx(mark["size"][0], rel=0.4)
        assert (read["known"], read["likeness"]) == ("watermark", 1.0)
    assert all(picture.startswith(b"\x89PNG") for picture in found.pictures)


def test_letters_that_only_the_shape_shows_are_read_in_relief_pictures() -> None:
    assert "relief" in {kind for mark in verified("none").report["marks"] for kind in mark["pictures"]}


def test_letters_that_were_shaken_by_noise_are_read_by_what_stands_out() -> None:
    shaken = attack_file(marked(color="none")[0], "noise", None, 0, None)
    [mark, *_] = verify(shaken, ["watermark"]).report["marks"]
    assert (mark["known"], "height" in mark["pictures"]) == ("watermark", True)


def test_what_the_metadata_say_is_told_beside() -> None:
    assert verified("auto").report["label"]["creator"] == "me"


def test_an_asset_without_marks_has_none() -> None:
    found = verify(SPOT, ["watermark"]).report
    assert (found["found"], found["marks"]) == ([], [])


def test_marks_are_found_without_knowing_what_they_say() -> None:
    found = verify(marked(color="auto")[0]).report
    assert found["found"] is None
    texts = [mark["text"] for mark in found["marks"]]
    assert texts.count("watermark") >= len(texts) - 1 > 0  # one letter of one mark may be misread


def test_marks_of_several_lines_are_one_text_and_a_turned_export_of_another_tool_is_read() -> None:
    model, marks = marked(text="AI\nGENERATED", label="eu", size=6.0, color="none")
    mesh = plain(scene_of(model).surface)
    turn = Rotation.from_euler("xyz", (20, 40, 10), degrees=True).as_matrix()
    other = trimesh.Trimesh(mesh.positions @ turn.T * 0.01, mesh.faces, process=False).export(file_type="stl")
    assert isinstance(other, bytes)
    found = verify(other, ["AI GENERATED"]).report
    assert marks
    assert found["found"] == ["AI GENERATED"]
    assert found["label"] is None


def test_broken_metadata_do_not_keep_marks_from_being_read() -> None:
    document = Document.from_glb(marked(color="auto")[0])
    document.json["extensions"]["KHR_xmp_json_ld"]["packets"] = 3
    found = verify(document.to_glb(), ["watermark"]).report
    assert (found["found"], found["label"]) == (["watermark"], None)
    assert [notice["code"] for notice in found["warnings"]] == ["malformed_file"]


def test_a_file_that_is_none_is_refused_as_everywhere() -> None:
    with pytest.raises(MeshmarkError) as error:
        verify(b"no model", ["watermark"])
    assert error.value.code is ErrorCode.UNKNOWN_FORMAT


def test_the_command_prints_what_it_read_and_writes_the_same_report_and_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, marks = marked(color="auto")
    file, report, pictures, evidence = (tmp_path / name for name in ("a.glb", "v.json", "pictures", "e.html"))
    file.write_bytes(model)
    asked = ["--text", "watermark", "--text", "another text", "--report", str(report), "--pictures", str(pictures)]
    asked += ["--evidence", str(evidence)]
    assert main(["verify", str(file), *asked]) == 0
    printed = capsys.readouterr().out
    assert f"{len(marks)} marks read" in printed
    assert 'not found: "another text"' in printed
    assert json.loads(report.read_text()) | {"timings": {}} == verified("auto").report | {"timings": {}}
    assert [path.read_bytes() for path in sorted(pictures.iterdir())] == list(verified("auto").pictures)
    assert all(base64.b64encode(picture) in evidence.read_bytes() for picture in verified("auto").pictures)
    assert main(["verify", str(tmp_path / "none.glb")]) == 66
