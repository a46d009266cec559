"""`meshmark` on the command line."""

import json
from pathlib import Path

import pytest

from core.artwork.fonts import DEFAULT_FONT
from core.cli import main
from core.cli.status import STATUS_OF
from core.errors import ErrorCode, MeshmarkError
from core.gltf.scene import scene_of
from tests.core.gltf.builder import CUBE, CUBE_FACES, simple
from tests.validator import error_counts

SPOT = Path(__file__).parents[2] / "data" / "spot.glb"


def test_apply_writes_the_model_the_report_and_the_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, report, preview = tmp_path / "out.glb", tmp_path / "report.json", tmp_path / "preview.png"
    pictures = tmp_path / "turntable.webp", tmp_path / "poster.webp"
    font = tmp_path / "font.ttf"
    font.write_bytes(DEFAULT_FONT.read_bytes())
    status = main(
        [
            *("apply", str(SPOT), str(model), "--text", "watermark", "--count", "2", "--color", "#00ff00"),
            *("--report", str(report), "--preview", str(preview), "--font", str(font), "--seed", "5"),
            *("--mode", "deboss", "--size", "3", "--relief", "0.1", "--preset", "provenance"),
            *("--evaluate", "geometry", "--strength", "strong", "--size-exact"),
            *("--turntable", str(pictures[0]), "--poster", str(pictures[1])),
        ]
    )
    assert status == 0
    assert not error_counts(model.read_bytes())
    assert preview.read_bytes().startswith(b"\x89PNG")
    assert {path.read_bytes()[8:12] for path in pictures} == {b"WEBP"}
    assert len(pictures[0].read_bytes()) > 10 * len(pictures[1].read_bytes())
    written = json.loads(report.read_text())
    asked = {"text": "watermark", "count": 2, "color": "#00ff00", "seed": 5, "mode": "deboss", "size": 3.0}
    asked |= {"strength": "strong", "size_exact": True}
    assert asked.items() <= written["parameters"].items()
    assert "2 watermarks" in capsys.readouterr().out


def test_regions_are_given_one_by_one(tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    arguments = [str(SPOT), str(tmp_path / "o.glb"), "--text", "a", "--report", str(report), "--evaluate", "none"]
    regions = [
        "--keep-out",
        "box=-1,0.2,-1.5,1,1.5,-0.3",
        "--keep-out",
        "box=-1,-1,0.9,1,1,2e0",
        "--prefer",
        "node=spot",
    ]
    assert main(["apply", *arguments, "--count", "1", "--size", "2", *regions]) == 0
    written = json.loads(report.read_text())["parameters"]
    assert written["keep_out"] == [
        {"box": {"min": [-1, 0.2, -1.5], "max": [1, 1.5, -0.3]}},
        {"box": {"min": [-1, -1, 0.9], "max": [1, 1, 2]}},
    ]
    assert written["prefer"] == [{"node": "spot"}]


def test_evaluate_none_leaves_the_metrics_out(tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    arguments = [str(SPOT), str(tmp_path / "o.glb"), "--text", "a", "--report", str(report), "--evaluate", "none"]
    assert main(["apply", *arguments]) == 0
    assert json.loads(report.read_text())["metrics"] is None


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["missing.glb", "out.glb", "--text", "a"], "missing_file"),
        ([str(SPOT), "out.glb", "--text", "a", "--keep-out", "node=Head"], "unknown_region"),
        ([str(SPOT), "out.glb", "--text", "a", "--keep-out", "Head"], "invalid_parameters"),
        ([str(SPOT), "out.glb", "--text", "a", "--prefer", "box=0,0,0,1,1"], "invalid_parameters"),
        ([str(SPOT), "out.glb", "--text", "   "], "empty_text"),
        ([str(SPOT), "out.glb", "--text", "\N{UNICORN FACE}"], "missing_glyphs"),
        ([str(SPOT), "out.glb", "--text", "a", "--size", "-1"], "invalid_parameters"),
        ([str(SPOT), "out.glb", "--text", "a", "--color", "red"], "invalid_parameters"),
        ([str(SPOT), "out.glb", "--text", "a", "--font", __file__], "invalid_font"),
        ([__file__, "out.glb", "--text", "a"], "unknown_format"),
        ([str(SPOT), "no/such/folder/out.glb", "--text", "a", "--count", "1"], "output_not_writable"),
    ],
)
def test_what_cannot_be_done_is_said_in_two_lines_and_nothing_is_written(
    arguments: list[str],
    code: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["apply", *arguments]) == STATUS_OF[ErrorCode(code)] != 0
    *stages, said, _remedy = capsys.readouterr().err.splitlines()
    assert all(stage.startswith(f"{arguments[0]}: ") for stage in stages)
    assert said.startswith(f"meshmark: {code}: ")
    assert list(tmp_path.iterdir()) == []


def test_wrong_usage_is_status_two(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["apply", "in.glb"]) == 2
    assert "OUT.glb" in capsys.readouterr().err


def test_a_preview_that_cannot_be_rendered_is_said_whatever_else_there_was_to_warn_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def unavailable(_: object) -> bytes:
        raise MeshmarkError(ErrorCode.RENDERING_UNAVAILABLE, "No EGL here.", "Install it.")

    monkeypatch.setattr("core.measuring.contact_sheet", unavailable)
    asset, model = tmp_path / "in.glb", tmp_path / "out.glb"
    document = simple(CUBE, CUBE_FACES)
    document.json["images"] = [{"uri": "beside.png"}]  # warned of as well, and before
    asset.write_bytes(document.to_glb())
    arguments = ["apply", str(asset), str(model), "--text", "a", "--preview", str(tmp_path / "preview.png")]
    assert main(arguments) == 69
    *stages, said, remedy = capsys.readouterr().err.splitlines()
    assert all(stage.startswith(f"{asset}: ") for stage in stages)
    assert [said, remedy] == ["meshmark: rendering_unavailable: No EGL here.", "Install it."]
    assert model.exists()


def test_an_attack_leaves_a_file_that_is_damaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    left = tmp_path / "left.glb"
    assert main(["attack", "crop", str(SPOT), str(left), "--strength", "0.3", "--seed", "2"]) == 0
    assert 0 < len(scene_of(left.read_bytes()).surface.faces) < 5856
    assert str(left) in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments", [["nonsense"], ["removal"], ["crop", "--strength", "7"], ["decimate", "--strength", "-1"]]
)
def test_an_attack_that_cannot_be_made_says_so_and_writes_nothing(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, *options = arguments
    assert main(["attack", name, str(SPOT), str(tmp_path / "left.glb"), *options]) == 2
    progress, said, _remedy = capsys.readouterr().err.splitlines()
    assert progress == f"{SPOT}: {name}"
    assert said.startswith("meshmark: invalid_parameters: ")
    assert list(tmp_path.iterdir()) == []
    assert list(tmp_path.iterdir()) == []


def test_models_are_listed_with_their_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MESHMARK_MODELS", str(tmp_path))
    assert main(["models", "list"]) == 0
    assert capsys.readouterr().out.split()[:2] == ["resnet50-v1-12-int8", "missing"]
    (tmp_path / "resnet50-v1-12-int8.onnx").write_bytes(b"half of it")
    assert main(["models", "list"]) == 0
    assert capsys.readouterr().out.split()[:2] == ["resnet50-v1-12-int8", "corrupt"]
    assert main(["models", "fetch", "nonsense", "--quiet"]) == 69
    assert capsys.readouterr().err.startswith("meshmark: model_unavailable: ")


def test_a_benchmark_writes_its_report_and_says_what_was_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    meshes, out = tmp_path / "meshes", tmp_path / "out"
    meshes.mkdir()
    (meshes / "spot.glb").write_bytes(SPOT.read_bytes())
    asked = ["--methods", "meshmark,li", "--counts", "4", "--attacks", "crop,subdivide:1", "--level", "geometry"]
    assert main(["benchmark", str(meshes), "--out", str(out), *asked]) == 0
    assert "6 rows, 0 of them refused or failed" in capsys.readouterr().out
    assert {"REPORT.md", "results.csv", "results.json", "rows.jsonl"} <= {path.name for path in out.iterdir()}
    assert main(["benchmark", str(meshes), "--out", str(out), "--methods", "nonsense"]) == 2
    assert capsys.readouterr().err.startswith("meshmark: invalid_parameters: ")


def test_a_profile_is_printed_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    meshes, out = tmp_path / "meshes", tmp_path / "out"
    meshes.mkdir()
    (meshes / "cube.glb").write_bytes(simple(CUBE, CUBE_FACES).to_glb())
    assert main(["profile", str(meshes), "--out", str(out), "--repeats", "2"]) == 0
    printed = capsys.readouterr().out
    assert "| cube.glb |" in printed
    assert "the quickest of 2 runs" in printed
    assert (out / "PROFILE.md").read_text() == printed
    assert json.loads((out / "profile.json").read_text())["repeats"] == 2
    assert main(["profile", str(tmp_path / "missing")]) == 66
    assert capsys.readouterr().err.startswith("meshmark: missing_file: ")
