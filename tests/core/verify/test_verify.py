"""Marks of real files are read back, and where there are none nothing is."""

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
from core.gltf.scene import scene_of
from core.lab.plain import Mesh, plain, plain_glb
from core.parameters import Parameters
from core.pipeline import watermark
from core.verify.verify import Verification, verify
from tests.core.placement.shapes import cuboid

SPOT = (Path(__file__).parents[2] / "data" / "spot.glb").read_bytes()


@cache
def marked(**asked: Any) -> tuple[bytes, list[dict[str, Any]]]:
    parameters = Parameters.model_validate({"text": "watermark", "count": 3, "evaluate": "none"} | asked)
    result = watermark(SPOT, parameters, preview=False)
    return result.model, result.report["watermarks"]


def centers(found: Verification) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([mark["center"] for mark in found.report["marks"]])


@pytest.mark.parametrize("color", ["auto", "none"])
def test_every_mark_is_read_where_it_stands(color: str) -> None:
    model, marks = marked(color=color)
    found = verify(model, ["watermark", "another text"])
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
    model, _ = marked(color="none")
    kinds = {kind for mark in verify(model, ["watermark"]).report["marks"] for kind in mark["pictures"]}
    assert "relief" in kinds


def test_an_asset_without_marks_has_none() -> None:
    found = verify(SPOT, ["watermark"]).report
    assert (found["found"], found["marks"]) == ([], [])


def test_marks_are_found_without_knowing_what_they_say() -> None:
    model, _ = marked(color="auto")
    found = verify(model).report
    assert found["found"] is None
    texts = [mark["text"] for mark in found["marks"]]
    assert texts.count("watermark") >= len(texts) - 1 > 0  # one letter of one mark may be misread


def test_marks_of_several_lines_are_one_text() -> None:
    model, marks = marked(text="AI\nGENERATED", label="eu", count=2, size=6.0)
    assert marks
    assert verify(model, ["AI GENERATED"]).report["found"] == ["AI GENERATED"]


def test_a_turned_and_scaled_export_by_another_tool_is_read() -> None:
    model, marks = marked(color="none")
    mesh = plain(scene_of(model).surface)
    turn = Rotation.from_euler("xyz", (20, 40, 10), degrees=True).as_matrix()
    other = trimesh.Trimesh(mesh.positions @ turn.T * 0.01, mesh.faces, process=False).export(file_type="stl")
    assert isinstance(other, bytes)
    found = verify(other, ["watermark"]).report
    assert found["found"] == ["watermark"]
    assert len(found["marks"]) >= len(marks) - 1
    assert found["label"] is None


def test_what_the_metadata_say_is_told_beside() -> None:
    model, _ = marked(text="", label="cn", metadata_only=True)
    found = verify(model, ["AI生成"]).report
    assert found["found"] == []
    assert found["label"]["aigc"][0]["fields"]["Label"] == "1"


def test_a_text_that_cannot_be_read_is_told_of() -> None:
    [notice] = verify(plain_glb(_plate()), ["שלום"]).report["warnings"]
    assert notice["code"] == "unreadable_script"


def test_a_file_that_is_none_is_refused_as_everywhere() -> None:
    with pytest.raises(MeshmarkError) as error:
        verify(b"no model", ["watermark"])
    assert error.value.code is ErrorCode.UNKNOWN_FORMAT


def test_the_command_prints_what_it_read_and_writes_report_and_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, marks = marked(color="auto")
    file, report, pictures = tmp_path / "a.glb", tmp_path / "v.json", tmp_path / "pictures"
    file.write_bytes(model)
    asked = ["--text", "watermark", "--text", "other", "--report", str(report), "--pictures", str(pictures)]
    assert main(["verify", str(file), *asked]) == 0
    printed = capsys.readouterr().out
    assert f"{len(marks)} marks read" in printed
    assert 'not found: "other"' in printed
    assert json.loads(report.read_text())["schema"] == "meshmark.verification/1"
    assert len(list(pictures.iterdir())) == len(marks)
    assert main(["verify", str(tmp_path / "none.glb")]) == 1


def test_the_same_file_gives_the_same_report() -> None:
    plate = plain_glb(_plate())
    one, other = verify(plate).report, verify(plate).report
    assert one | {"timings": {}} == other | {"timings": {}}


def _plate() -> Mesh:
    box = cuboid(30, 20, 4)
    return Mesh(box.positions, box.faces)
