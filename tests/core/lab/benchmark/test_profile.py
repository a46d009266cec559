"""A profile adds up, says the same to people and programs, and hides no asset."""

import json
import os
import resource
from pathlib import Path, PosixPath
from typing import Any

import numpy as np
import pytest
import trimesh

from core.choices import Evaluate
from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.markdown import number
from core.lab.benchmark.profile import EVERY_STAGE, TO_THE_MODEL, _run_apart, markdown, profile, write_profile
from core.lab.benchmark.statistics import power_law
from core.parameters import Parameters

SPOT = Path(__file__).parents[3] / "data" / "spot.glb"
BALLS = {"coarse.stl": 1, "fine.stl": 3}  # subdivisions: 80 and 1280 faces


def ball(path: Path, subdivisions: int) -> None:
    trimesh.creation.icosphere(subdivisions=subdivisions).export(path)


@pytest.fixture(scope="module")
def profiled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Of three assets that are watermarked, one with too little room, one that is cut short and a text file."""
    folder = tmp_path_factory.mktemp("meshes")
    (folder / "spot.glb").write_bytes(SPOT.read_bytes())
    (folder / "short.glb").write_bytes(SPOT.read_bytes()[:1000])
    (folder / "notes.txt").write_text("not a mesh")
    trimesh.creation.cylinder(0.001, 10).export(folder / "wire.stl")
    for name, subdivisions in BALLS.items():
        ball(folder / name, subdivisions)
    return profile(folder)


def by_name(profiled: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {row["asset"]: row for row in profiled["assets"]}


def marked(profiled: dict[str, Any]) -> list[dict[str, Any]]:
    return [row for row in profiled["assets"] if row["status"] == "ok"]


def tables(text: str) -> list[list[list[str]]]:
    """The cells of every table, headers first, without the rules."""
    blocks = [block for block in text.split("\n\n") if block.startswith("|")]
    cells = [[[cell.strip() for cell in line.strip("|").split("|")] for line in block.splitlines()] for block in blocks]
    return [lines[:1] + lines[2:] for lines in cells]


def test_every_asset_is_there_by_its_number_of_faces(profiled: dict[str, Any]) -> None:
    assert [(row["asset"], row["faces"]) for row in marked(profiled)] == [
        ("coarse.stl", 80),
        ("fine.stl", 1280),
        ("spot.glb", 5856),
    ]
    assert by_name(profiled)["spot.glb"]["bytes"] == SPOT.stat().st_size
    assert by_name(profiled)["coarse.stl"]["vertices"] == 42


def test_stages_sum_to_the_total_and_the_ratio_is_to_the_floor(profiled: dict[str, Any]) -> None:
    for row in marked(profiled):
        assert list(row["seconds"]) == list(row["processor"]) == list(row["memory"]) == TO_THE_MODEL
        assert row["processor_total"] == pytest.approx(sum(row["processor"].values()))
        assert row["processor"]["placing"] > 0
        assert row["total"] == pytest.approx(sum(row["seconds"].values()))
        assert row["ratio"] == pytest.approx(row["total"] / row["floor"])
        assert 0 < row["floor"] < row["total"]
        assert row["peak"] == row["memory"]["writing"] >= row["memory"]["reading"] > 1e6


def test_a_refused_asset_is_listed_with_its_code(profiled: dict[str, Any]) -> None:
    codes = {name: row["code"] for name, row in by_name(profiled).items() if row["status"] != "ok"}
    assert codes == {"short.glb": "truncated_file", "wire.stl": "no_placement"}
    listed = tables(markdown(profiled))[-1]
    assert [line[:3] for line in listed[1:]] == [
        ["short.glb", "-", "truncated_file"],
        ["wire.stl", "128", "no_placement"],
    ]
    assert "3 of 5 assets watermarked" in markdown(profiled)
    assert "notes.txt" in markdown(profiled)


def test_a_line_for_each_stage_gives_its_share_and_how_it_grows_with_faces(profiled: dict[str, Any]) -> None:
    lines = {line["stage"]: line for line in profiled["stages"]}
    assert list(lines) == [*TO_THE_MODEL, "without metrics", "floor"]
    assert sum(lines[stage]["share"] for stage in TO_THE_MODEL) == pytest.approx(1)
    assert lines["without metrics"]["share"] == pytest.approx(1)
    rows = marked(profiled)
    for stage in TO_THE_MODEL:
        seconds = [row["seconds"][stage] for row in rows]
        law = power_law([row["faces"] for row in rows], seconds)
        assert law is not None
        assert (lines[stage]["law"]["exponent"], lines[stage]["law"]["half"]) == (law.exponent, law.half)
        assert lines[stage]["longest"] == max(seconds)
        assert lines[stage]["peak"] == max(row["memory"][stage] for row in rows)
    assert profiled["ratio"]["of_sums"] == pytest.approx(1 / lines["floor"]["share"])
    assert profiled["ratio"]["least"] <= profiled["ratio"]["median"] <= profiled["ratio"]["most"]


def test_the_markdown_says_what_the_json_says(profiled: dict[str, Any], tmp_path: Path) -> None:
    write_profile(profiled, tmp_path / "new")
    read = json.loads((tmp_path / "new" / "profile.json").read_text())
    assert read == profiled
    text = (tmp_path / "new" / "PROFILE.md").read_text()
    assert text == markdown(read)
    assets, stages, _ = tables(text)
    for line, row in zip(assets[1:], marked(read), strict=True):
        seconds = [number(row["seconds"][stage]) for stage in TO_THE_MODEL]
        counts = [f"{row[name]:,}" for name in ("bytes", "vertices", "faces")]
        whole = [number(row[name]) for name in ("total", "processor_total", "floor", "ratio")]
        assert line == [row["asset"], *counts, *seconds, *whole, f"{row['peak'] / 1e6:,.0f}"]
    for cells, line in zip(stages[1:], read["stages"], strict=True):
        growth = f"{number(line['law']['exponent'])} ± {number(line['law']['half'])}"
        assert cells[:6] == [
            line["stage"],
            number(line["mean"]),
            "-" if line["stage"] == "floor" else number(line["processor"]),
            number(line["longest"]),
            f"{line['share']:.1%}",
            growth,
        ]


def test_the_peak_is_of_the_assets_own_run(tmp_path: Path) -> None:
    held = np.ones(10**8)  # 800 MB on top of what other tests left
    highest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    del held
    ball(tmp_path / "coarse.stl", 1)
    (row,) = profile(tmp_path)["assets"]
    assert row["peak"] < highest


class Deadly(PosixPath):
    """A file that ends the process that reads it."""

    def read_bytes(self) -> bytes:
        os._exit(3)


def test_a_process_that_ends_without_a_result_is_a_row_and_not_a_hang() -> None:
    row = _run_apart(Deadly("cow.glb"), Parameters(text="a"))
    assert (row["status"], row["code"]) == ("failed", "engine_crashed")
    assert "exit status 3" in row["message"]


def test_with_metrics_the_later_stages_are_timed_too(tmp_path: Path) -> None:
    ball(tmp_path / "coarse.stl", 1)
    found = profile(tmp_path, evaluate=Evaluate.GEOMETRY)
    (row,) = found["assets"]
    assert list(row["seconds"]) == EVERY_STAGE
    assert row["seconds"]["rendering"] > 0 < row["seconds"]["evaluating"]
    assert row["total"] == pytest.approx(sum(row["seconds"][stage] for stage in TO_THE_MODEL))
    names = [*TO_THE_MODEL, "without metrics", "reporting", "rendering", "evaluating", "floor"]
    assert [line["stage"] for line in found["stages"]] == names
    assert [line[0] for line in tables(markdown(found))[1][1:]] == names
    assert "coarse.stl: not measured: ocr" in markdown(found), "pictures were not asked for"
    assert {line["law"] for line in found["stages"]} == {None}, "one asset says nothing of growth"


def test_a_folder_of_nothing_but_refused_assets_still_gives_a_profile(tmp_path: Path) -> None:
    (tmp_path / "short.glb").write_bytes(SPOT.read_bytes()[:1000])
    found = profile(tmp_path, repeats=2)
    assert found["stages"] == []
    assert "0 of 1 assets watermarked" in markdown(found)
    assert "truncated_file" in markdown(found)


def test_an_empty_folder_and_no_repeats_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MeshmarkError) as empty:
        profile(tmp_path)
    assert empty.value.code is ErrorCode.MISSING_FILE
    assert "--dataset" not in empty.value.remedy
    with pytest.raises(MeshmarkError) as none:
        profile(tmp_path, repeats=0)
    assert none.value.code is ErrorCode.INVALID_PARAMETERS
