"""Options of `meshmark apply`."""

import json
from pathlib import Path

import pytest
import typer

from core.cli import main
from core.cli.app import load_command
from core.cli.apply import format_of, parameters_of
from core.cli.order import Order, export_path
from core.errors import MeshmarkError
from core.formats.format import Format, OutputFile
from core.parameters import Parameters
from core.preview_model import PreviewModel
from tests.core.gltf.builder import CUBE, CUBE_FACES, simple


def given(*options: str) -> Parameters:
    context = load_command("apply").make_context("apply", ["in.glb", "out.glb", *options])
    assert context.params["logo"] is None
    return parameters_of(context.params)


def test_the_setting_of_the_text_is_that_of_the_parameters() -> None:
    options = "--text a\\nb --align left --line-spacing 1.5 --letter-spacing 0.1 --direction vertical --language ja"
    assert given(*options.split()) == Parameters.model_validate(
        {
            "text": "a\nb",
            "align": "left",
            "line_spacing": 1.5,
            "letter_spacing": 0.1,
            "direction": "vertical",
            "language": "ja",
            "evaluate": "none",
        }
    )


def test_without_options_the_defaults_are_those_of_the_parameters() -> None:
    assert given("--text", "a", "--report", "r.json") == Parameters(text="a")


def test_a_direction_that_is_none_is_refused() -> None:
    with pytest.raises(typer.TyperException, match="'up' is not one of"):
        given("--text", "a", "--direction", "up")


def test_a_label_is_asked_for_with_a_file_of_statements(tmp_path: Path) -> None:
    (tmp_path / "d.json").write_text(json.dumps({"creator": "me"}))
    asked = given("--label", "cn", "--declaration", str(tmp_path / "d.json"), "--metadata-only", "--evaluate", "full")
    assert asked == Parameters.model_validate({"label": "cn", "declaration": {"creator": "me"}, "metadata_only": True})


@pytest.mark.parametrize("content", [None, "{"])
def test_statements_that_cannot_be_read_are_refused(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "d.json").write_text(content)
    with pytest.raises(MeshmarkError, match="cannot be read"):
        given("--label", "cn", "--declaration", str(tmp_path / "d.json"))


def test_a_preview_model_is_asked_for_by_its_name_or_in_the_place_of_the_model() -> None:
    beside = given("--text", "a", "--preview-model", "l.glb", "--preview-triangles", "900")
    assert beside.preview_model == PreviewModel(triangles=900)
    alone = given("--text", "a", "--preview-alone", "--preview-texture", "64")
    assert alone.preview_model == PreviewModel(texture=64, alone=True)
    assert given("--text", "a").preview_model is None


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--preview-alone", "--preview-model", "l.glb"], "names another"),
        (["--preview-triangles", "900"], "none is asked for"),
        (["--preview-model", "l.glb", "--preview-triangles", "1"], "preview_model.triangles"),
    ],
)
def test_a_preview_model_of_two_kinds_of_none_or_of_no_triangles_is_refused(options: list[str], problem: str) -> None:
    with pytest.raises(MeshmarkError, match=problem):
        given("--text", "a", *options)


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("o.glb", "glb"), ("o.STL", "stl"), ("o.ply", "ply"), ("o.3mf", "3mf"), ("o.zip", "obj"), ("-", "glb")],
)
def test_the_ending_of_a_result_says_its_format(name: str, wanted: str) -> None:
    assert format_of(Path(name)) == wanted


def test_an_obj_has_to_be_a_zip() -> None:
    with pytest.raises(MeshmarkError, match=r"materials and textures. Name a ZIP of them: a/o.zip"):
        format_of(Path("a/o.obj"))


def test_another_format_lies_beside_the_glb_and_never_on_the_input() -> None:
    written = OutputFile(Format.OBJ_ZIP, b"")
    assert export_path(Order(Path("a.obj"), Path("b/a.glb")), written) == Path("b/a.zip")
    assert export_path(Order(Path("a.obj"), Path("b/a.zip")), written) == Path("b/a.zip")
    assert export_path(Order(Path("-"), Path("-")), written) == Path("-")
    with pytest.raises(MeshmarkError, match="is the input"):
        export_path(Order(Path("a.stl"), Path("a.glb")), OutputFile(Format.STL, b""))


def test_one_file_is_written_where_out_has_the_ending_of_a_format(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "1")  # which the command would set for good
    source, result = tmp_path / "cube.glb", tmp_path / "cube.stl"
    source.write_bytes(simple(CUBE, CUBE_FACES).to_glb())
    assert main(["apply", str(source), "-o", str(result), "--label", "eu", "--metadata-only"]) == 0
    assert len(result.read_bytes()) == 84 + 50 * 12
    folder = tmp_path / "out"
    assert main(["apply", str(source), "-o", str(folder), "--label", "eu", "--metadata-only", "--format", "3mf"]) == 0
    assert {path.name for path in folder.iterdir()} == {"cube.glb", "cube.3mf"}
