"""Marks of a job are told from what the original has there."""

import io
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from core.budgets import DEFAULT_BUDGETS
from core.cli import main
from core.errors import ErrorCode, MeshmarkError
from core.gltf.scene import scene_of
from core.lab.plain import Mesh, plain_glb
from core.parameters import Parameters
from core.pipeline import watermark
from core.verify.marks import FoundMark
from core.verify.original import Against, Aligned, Reference, align, compare, read_reference
from core.verify.readings import Spot
from core.verify.registration import Registration, Similarity, registrations
from core.verify.report import Comparison
from core.verify.verify import verify
from tests.core.placement.shapes import cuboid
from tests.core.verify.test_verify import SPOT

NOTHING = np.zeros((4, 4, 3), dtype=np.uint8)


@cache
def job() -> tuple[bytes, bytes]:
    """The result of a job and its report."""
    asked = {"text": "ORDER 4711", "count": 3, "evaluate": "none", "color": "none"}
    result = watermark(SPOT, Parameters.model_validate(asked), preview=False)
    return result.model, json.dumps(result.report).encode()


def changed(**values: Any) -> bytes:
    return json.dumps(json.loads(job()[1]) | values).encode()


@cache
def reference() -> Reference:
    return read_reference(Against(SPOT, job()[1]), DEFAULT_BUDGETS)


@cache
def aligned(suspect: bytes) -> Aligned:
    return align(scene_of(suspect).surface, reference())


def compared(suspect: bytes, original: Reference) -> Comparison:
    section, pictures = compare(scene_of(suspect).surface, suspect, aligned(suspect), original, [])
    assert len(pictures) == len(section.marks)
    return section


def test_every_mark_of_the_job_is_there() -> None:
    found = compared(job()[0], reference())
    assert [mark.present for mark in found.marks] == [True] * 3
    assert all(mark.height > 0 for mark in found.marks)
    assert min(mark.correlation or 0 for mark in found.marks) > 0.9
    assert (found.is_asset, found.is_result) == (True, True)
    assert {mark.text for mark in found.marks} == {"ORDER 4711"}


def test_marks_are_there_too_on_a_model_that_was_turned_and_scaled() -> None:
    surface = scene_of(job()[0]).surface
    turn = Rotation.from_euler("xyz", (20, 40, 110), degrees=True).as_matrix()
    world = surface.to_world(surface.positions) @ turn.T * 40 + [100, 0, 7]
    found = compared(plain_glb(Mesh(world, surface.faces)), reference())
    assert [mark.present for mark in found.marks] == [True] * 3
    assert found.is_result is False
    assert found.scale == pytest.approx(1 / 40, rel=1e-3)
    np.testing.assert_allclose(found.rotation, turn.T, atol=1e-3)
    back = np.array([100.0, 0, 7]) @ np.array(found.rotation).T * found.scale + found.translation
    np.testing.assert_allclose(back, 0, atol=1e-3)


def test_the_original_itself_has_none_of_them() -> None:
    found = compared(SPOT, reference())
    assert [mark.present for mark in found.marks] == [False] * 3
    assert all(mark.standing_out == mark.height == 0 for mark in found.marks)


def test_where_the_surface_is_gone_nothing_is_said() -> None:
    surface = scene_of(job()[0]).surface
    box = reference().boxes
    gone = np.linalg.norm(surface.positions - box.center[0], axis=1) < box.size[0, 0]
    faces = surface.faces[~gone[surface.faces].any(axis=1)]
    found = compared(plain_glb(Mesh(surface.to_world(surface.positions), faces)), reference())
    assert found.marks[0].present is None
    assert True in [mark.present for mark in found.marks]


def test_marks_whose_artwork_the_report_does_not_hold_are_told_by_what_stands_out() -> None:
    report = json.loads(job()[1])
    report["watermarks"] = [mark | {"logo": "svg"} for mark in report["watermarks"]]
    original = read_reference(Against(SPOT, json.dumps(report).encode()), DEFAULT_BUDGETS)
    found = compared(job()[0], original)
    assert [(mark.present, mark.correlation) for mark in found.marks] == [(True, None)] * 3
    assert [mark.present for mark in compared(SPOT, original).marks] == [False] * 3


def test_without_a_report_the_relief_of_what_was_read_is_told() -> None:
    original = read_reference(Against(SPOT), DEFAULT_BUDGETS)
    box, surface = reference().boxes, scene_of(job()[0]).surface
    spot = Spot(0.0, box.center[0], box.axes[0, 0], box.axes[0, 2], float(box.size[0, 0]), float(box.size[0, 1]))
    read = FoundMark("0RDER 4711", "ORDER 4711", 0.9, 0.9, 2, ("relief",), spot, NOTHING)
    found, pictures = compare(surface, job()[0], aligned(job()[0]), original, [read])
    [mark] = found.marks
    assert len(pictures) == 1
    assert (mark.index, mark.text, mark.present, mark.correlation) == (0, "ORDER 4711", None, None)
    assert mark.height == pytest.approx(json.loads(job()[1])["watermarks"][0]["relief"], rel=0.3)
    assert (found.is_asset, found.is_result) == (None, None)


def test_an_original_that_is_another_model_is_refused() -> None:
    box = cuboid(30, 20, 4)
    with pytest.raises(MeshmarkError, match=r"not the same model: .* residual of [\d.]+ %") as error:
        verify(plain_glb(Mesh(box.positions, box.faces)), ["ORDER 4711"], against=Against(SPOT))
    assert error.value.code is ErrorCode.DIFFERENT_MODEL


def test_an_alignment_that_does_not_fit_is_not_taken_for_the_marks_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    surface = scene_of(job()[0]).surface
    [fits, *_] = registrations(surface, reference().surface)
    off = Similarity(1.0, fits.similarity.rotation, fits.similarity.translation + np.array([0, 3, 0]))
    apart = Registration(off, residual=0.001, covered=0.9)
    loose = Registration(fits.similarity, residual=0.008, covered=0.9)
    monkeypatch.setattr("core.verify.original.registrations", lambda *_: [apart, loose])
    assert align(surface, reference()).registration is apart
    monkeypatch.setattr("core.verify.original.registrations", lambda *_: [loose])
    with pytest.raises(MeshmarkError, match="not the same model"):
        align(surface, reference())


@pytest.mark.parametrize(
    "report",
    [
        b"no JSON",
        b"[]",
        b'{"schema": "meshmark.report/2"}',
        b'{"watermarks": []}',
    ],
)
def test_a_report_that_is_none_is_refused(report: bytes) -> None:
    with pytest.raises(MeshmarkError) as error:
        read_reference(Against(SPOT, report), DEFAULT_BUDGETS)
    assert error.value.code is ErrorCode.INVALID_PARAMETERS


def test_a_report_of_more_marks_than_a_job_makes_is_refused() -> None:
    many = changed(watermarks=json.loads(job()[1])["watermarks"] * 100)
    with pytest.raises(MeshmarkError, match="300 watermarks") as error:
        read_reference(Against(SPOT, many), DEFAULT_BUDGETS)
    assert error.value.code is ErrorCode.INVALID_PARAMETERS


def test_a_picture_has_no_shape_to_compare() -> None:
    file = io.BytesIO()
    Image.fromarray(NOTHING).save(file, "PNG")
    with pytest.raises(MeshmarkError, match="picture") as error:
        verify(file.getvalue(), against=Against(SPOT))
    assert error.value.code is ErrorCode.INVALID_PARAMETERS


def test_a_report_needs_the_file_that_its_job_marked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "spot.glb"
    file.write_bytes(SPOT)
    assert main(["verify", str(file), "--report-of", str(file)]) == 2
    assert "`--original`" in capsys.readouterr().err


def test_the_texts_of_a_report_are_those_that_are_looked_for() -> None:
    assert reference().texts == ("ORDER 4711",)
