"""`meshmark explain`: a folder that says why marks stand where they stand."""

import json
from pathlib import Path

import pytest

from core.cli import main
from tests.core.explain.test_explain import asset


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("core.explain.layers.PICTURE", 64)


def test_page_pictures_model_and_figures_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "box.glb").write_bytes(asset())
    (tmp_path / "p.json").write_text('{"text": "other", "count": 2}')
    out = tmp_path / "why"
    files = [str(tmp_path / "box.glb"), "--out", str(out), "--params", str(tmp_path / "p.json")]
    assert main(["explain", *files, "--text", "AB"]) == 0
    assert capsys.readouterr().out.startswith(f"{out / 'index.html'}: 2 marks among ")
    assert {"index.html", "explanation.glb", "explanation.json", "marks.png", "mark-2.png"} <= {
        path.name for path in out.iterdir()
    }


def test_where_nothing_finds_a_place_the_page_is_written_and_the_status_tells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "box.glb").write_bytes(asset())
    everything = {"min": [-99, -99, -99], "max": [99, 99, 99]}
    (tmp_path / "p.json").write_text(json.dumps({"text": "AB", "keep_out": [{"box": everything}]}))
    asset_file, out = str(tmp_path / "box.glb"), tmp_path / "why"
    status = main(["explain", asset_file, "--out", str(out), "--params", str(tmp_path / "p.json"), "--json"])
    told = capsys.readouterr()
    box = ["--keep-out", "box=-99,-99,-99,99,99,99"]
    assert status == main(["apply", asset_file, str(tmp_path / "o.glb"), "--text", "AB", *box])
    assert status != 0
    assert json.loads(told.out)["error"]["code"] == "no_placement"
    assert (tmp_path / "why" / "index.html").exists()
