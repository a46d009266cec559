"""Watermarked results in other formats, as slicers and modelling programs get them."""

import io
import json
import re
import subprocess
import zipfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from core import exporting, marking
from core.choices import Evaluate, FileFormat, Profile
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.formats.format import Format
from core.gltf.scene import Scene, flatten
from core.labels.profiles import Label
from core.metrics.topology import topology
from core.notices import NoticeCode
from core.parameters import Parameters
from core.pipeline import watermark
from core.stages import Asset, Exported, Output, Request, Run
from tests.core.formats.samples import DAE, OFF, STL_BINARY, png, threemf_cube, threemf_model, zipped

# A box of three objects, 30 wide: its sides are 0.1 and 0.3 off the whole numbers, which 32 bits do not hold.
BOX = zipped(
    {
        "box.obj": b"mtllib box.mtl\n"
        + b"".join(b"v %.1f %.1f %.1f\n" % (x + 0.1, y + 0.3, z) for x in (0, 30) for y in (0, 12) for z in (0, 20))
        + b"vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        b"o ends\nusemtl red\nf 1/1 2/2 4/3 3/4\nf 5/1 7/2 8/3 6/4\n"
        b"o faces\ng front\nusemtl wood\nf 1/1 5/2 6/3 2/4\ng back\nf 3/1 4/2 8/3 7/4\n"
        b"o lids\ng lids\nusemtl red\nf 1/1 3/2 7/3 5/4\nf 2/1 6/2 8/3 4/4\n",
        "box.mtl": "newmtl red\nKd 1 0 0\nnewmtl wood\nmap_Kd wood.png\n",
        "wood.png": png(160, 120, 80, 64),
    }
)
SIX = Parameters(text="HI", count=6, color="#101010", evaluate=Evaluate.NONE, profile=Profile.FLAT).resolved()


def run_of(parameters: Parameters) -> Run:
    return Run(Request(parameters, preview=False), lambda _share: None, lambda _name, _data: None)


@pytest.fixture(scope="module")
def box() -> tuple[Asset, Output]:
    run = run_of(SIX)
    asset = marking.read(BOX, run.request.budgets, run.request.parameters.format)
    candidates = marking.place(asset, marking.letter(run), run)
    return asset, marking.write_model(asset, candidates.ground, marking.emboss(asset, candidates, run), run)


def export(box: tuple[Asset, Output], asked: FileFormat) -> Exported:
    exported = exporting.with_export(*box, run_of(SIX.model_copy(update={"format": asked}))).exported
    assert exported is not None
    return exported


def scene_of(data: bytes) -> Scene:
    return flatten(document_of(admit(data)))


def test_letters_belong_to_the_objects_and_groups_that_they_stand_on(box: tuple[Asset, Output]) -> None:
    exported = export(box, FileFormat.SAME)
    assert exported.file.format is Format.OBJ_ZIP
    archive = zipfile.ZipFile(io.BytesIO(exported.file.data))
    assert set(archive.namelist()) == {"box.obj", "box.mtl", "wood.png", "box-letters.mtl"}
    assert archive.read("wood.png") == png(160, 120, 80, 64)
    points, planes = [], {"ends": (0, (0.1, 30.1)), "faces": (1, (0.3, 12.3)), "lids": (2, (0.0, 20.0))}
    used, owner, material = Counter[tuple[str, str]](), "", ""
    for line in archive.read("box.obj").decode().splitlines():
        word, *rest = line.split()
        if word == "v":
            points.append([float(number) for number in rest[:3]])
        elif word == "o":
            owner = rest[0]
        elif word == "usemtl":
            material = " ".join(rest)
        elif word == "f":
            axis, sides = planes[owner]
            at = [points[int(corner.split("/")[0]) - 1][axis] for corner in rest]
            side = min(sides, key=lambda side: abs(side - float(np.mean(at))))
            assert max(abs(value - side) for value in at) < 1.5, "no farther than a letter rises"
            used[owner, material] += 1
    assert {owner for owner, _ in used} == set(planes)
    letters = {material for _, material in used} - {"red", "wood"}
    assert len(letters) == 2, "a colour on each ground"
    kd = re.findall(rb"newmtl (.+)\nKd (\S+) (\S+) (\S+)", archive.read("box-letters.mtl"))
    assert {name.decode() for name, *_ in kd} == letters
    assert all(abs(float(value) - 16 / 255) < 0.07 for _, *color in kd for value in color)


def test_untouched_corners_have_their_very_numbers(box: tuple[Asset, Output]) -> None:
    archive = zipfile.ZipFile(io.BytesIO(export(box, FileFormat.SAME).file.data))
    texts = {line for line in archive.read("box.obj").decode().splitlines() if line.startswith("v ")}
    assert {f"v {x} {y} {z}" for x in (0.1, 30.1) for y in (0.3, 12.3) for z in (0.0, 20.0)} <= texts


@pytest.mark.parametrize("asked", [FileFormat.SAME, FileFormat.STL, FileFormat.PLY, FileFormat.THREEMF])
def test_a_result_is_the_surface_of_the_glb(box: tuple[Asset, Output], asked: FileFormat) -> None:
    exported, surface = export(box, asked), box[1].scene.surface
    again = scene_of(exported.file.data).surface
    assert topology(again) == topology(surface) or asked is FileFormat.PLY
    assert len(again.faces) == len(surface.faces)
    size = 30 / surface.scale * (1e-3 if asked is FileFormat.THREEMF else 1)
    assert 30 / again.scale == pytest.approx(size, rel=1e-7)
    assert exported.file.data == export(box, asked).file.data


def test_what_a_format_cannot_hold_is_told(box: tuple[Asset, Output]) -> None:
    run = run_of(SIX.model_copy(update={"format": FileFormat.STL}))
    exporting.with_export(*box, run)
    [notice] = run.notices
    assert notice.code == NoticeCode.LEFT_OUT_OF_EXPORT
    assert "textures, materials and colours" in notice.message


@pytest.mark.parametrize("asked", [FileFormat.STL, FileFormat.THREEMF])
def test_a_slicer_prints_the_result(box: tuple[Asset, Output], asked: FileFormat, tmp_path: Path) -> None:
    model, gcode = tmp_path / f"box.{asked}", tmp_path / "box.gcode"
    model.write_bytes(export(box, asked).file.data)
    slicer = ["prusa-slicer", "--datadir", str(tmp_path / "data")]
    told = subprocess.run([*slicer, "--info", model], capture_output=True, text=True, check=True).stdout
    assert "manifold = yes" in told
    assert f"number_of_facets = {len(box[1].scene.surface.faces)}" in told
    options = [
        "--layer-height",
        "0.5",
        "--first-layer-height",
        "0.5",
        "--nozzle-diameter",
        "0.6",
        "--fill-density",
        "0",
    ]
    subprocess.run([*slicer, *options, "--export-gcode", "-o", gcode, model], capture_output=True, check=True)
    layers = gcode.read_text().count(";LAYER_CHANGE")
    assert layers >= 40, "20 mm of half a millimetre, and the letters on top"


def test_the_report_has_the_export_and_the_file_is_published() -> None:
    published: dict[str, bytes] = {}
    asked = Parameters(label=Label.EUROPE, metadata_only=True, format=FileFormat.STL)
    result = watermark(STL_BINARY, asked, preview=False, publish=lambda name, data: published.update({name: data}))
    assert result.export is not None
    assert published["export"] == result.export.data
    facts = result.report["export"]
    assert (facts["format"], facts["bytes"], facts["unit"], facts["up"]) == (
        "stl",
        len(published["export"]),
        None,
        None,
    )
    assert published["export"].startswith(b"meshmark ")
    assert b"lgorithmicMedia" in published["export"][:80], "the label"
    obj = watermark(STL_BINARY, asked.model_copy(update={"format": FileFormat.OBJ}), preview=False).export
    assert obj is not None
    assert b"# DigitalSourceType: http" in zipfile.ZipFile(io.BytesIO(obj.data)).read("model.obj")
    assert json.loads(published["report"])["export"] == facts


def test_a_format_that_is_not_written_is_refused_before_any_work() -> None:
    run = run_of(SIX.model_copy(update={"format": FileFormat.SAME}))
    with pytest.raises(MeshmarkError) as caught:
        marking.read(DAE, run.request.budgets, run.request.parameters.format)
    assert caught.value.code is ErrorCode.UNSUPPORTED_FORMAT
    marking.read(OFF, run.request.budgets, run.request.parameters.format)


def test_one_of_several_uses_of_a_part_carries_the_mark_and_the_others_stay_one() -> None:
    cube = threemf_cube()
    model = threemf_model(
        f'<object id="1" name="cube">{cube}</object><object id="2" name="pair"><components><component objectid="1"/>'
        '<component objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 2.5"/></components></object>',
        '<item objectid="2"/><item objectid="2" transform="1 0 0 0 1 0 0 0 1 4.5 0 0"/>',
    )
    run = run_of(SIX.model_copy(update={"count": 1, "format": FileFormat.SAME}))
    asset = marking.read(zipped({"3D/3dmodel.model": model}), run.request.budgets, run.request.parameters.format)
    candidates = marking.place(asset, marking.letter(run), run)
    output = marking.write_model(asset, candidates.ground, marking.emboss(asset, candidates, run), run)
    exported = exporting.with_export(asset, output, run).exported
    assert exported is not None
    written = zipfile.ZipFile(io.BytesIO(exported.file.data)).read("3D/3dmodel.model").decode()
    assert written.count("<mesh>") == 2
    assert written.count("<components>") == 2, "the pair with the mark, and the pair without"
    assert written.count("<item ") == 2
    assert written.count("4.5 0 0") == 1
    again = scene_of(exported.file.data).surface
    assert len(again.faces) == len(output.scene.surface.faces)
    assert topology(again) == topology(output.scene.surface)
