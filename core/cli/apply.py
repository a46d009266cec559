"""The command `meshmark apply`."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from core.choices import (
    Align,
    Direction,
    Evaluate,
    FileFormat,
    LogoPosition,
    Mode,
    Preset,
    Profile,
    Strength,
    UnmarkedCopies,
    Wrap,
)
from core.cli.batch import Folders, mark_many, orders
from core.cli.files import STANDARD, read_file, require_streams
from core.cli.options import Json, Quiet
from core.cli.order import Order, Style, Telling, mark_one
from core.cli.status import Status
from core.cli.texts import INDEX, read_texts
from core.errors import ErrorCode, MeshmarkError
from core.labels.profiles import Label
from core.parameters import Parameters, parse_parameters

MANY, TEXT, MARKS, LABEL, PLACES, RESULTS = "Many files", "Text and logo", "Marks", "Label", "Places", "Results"
LIGHT = "Preview model"
USAGE = "IN OUT.glb | IN... --out DIR"
ENDINGS = {
    ".stl": FileFormat.STL,
    ".ply": FileFormat.PLY,
    ".3mf": FileFormat.THREEMF,
    ".zip": FileFormat.OBJ,
    ".obj": FileFormat.OBJ,
}
EPILOG = """Examples:

meshmark apply dragon.glb preview.glb --text DRAFT --color "#d02020"
meshmark apply models --out marked --text "Example Ltd" --jobs 4
meshmark apply part.stl -o marked.stl --text "Example Ltd" --color none
meshmark apply lamp.glb --out lamps --copies orders.csv
meshmark apply 'in/*.stl' --out marked --logo logo.svg --report reports
meshmark apply - - --label eu < in.glb > out.glb"""
REGION = (
    "node=NAME, material=NAME, or box=X,Y,Z,X,Y,Z from its lowest to its highest corner in the asset's coordinates. "
    "May be repeated."
)


def apply(
    paths: Annotated[list[Path], typer.Argument(metavar="OUT.glb", hidden=True)],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="DIR", help="Mark all IN, and write the results there.", rich_help_panel=MANY
        ),
    ] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", metavar="N", min=1, help="Files at once.", rich_help_panel=MANY)
    ] = 1,
    text: Annotated[
        str, typer.Option(metavar="T", help=r"What to emboss; \n begins a line.", rich_help_panel=TEXT)
    ] = "",
    wrap: Annotated[Wrap, typer.Option(help=r"Lines of a text without \n.", rich_help_panel=TEXT)] = Wrap.AUTO,
    align: Annotated[Align, typer.Option(help="Where shorter lines stand.", rich_help_panel=TEXT)] = Align.CENTER,
    line_spacing: Annotated[float, typer.Option(metavar="EMS", help="From line to line.", rich_help_panel=TEXT)] = 1.2,
    letter_spacing: Annotated[
        float, typer.Option(metavar="EMS", help="Added between letters.", rich_help_panel=TEXT)
    ] = 0.0,
    direction: Annotated[
        Direction,
        typer.Option(help="Of the lines; vertical is for Chinese, Japanese and Korean.", rich_help_panel=TEXT),
    ] = Direction.HORIZONTAL,
    language: Annotated[
        str | None,
        typer.Option(metavar="TAG", help="zh-Hans, zh-Hant, ja, ko, ...; default: guessed.", rich_help_panel=TEXT),
    ] = None,
    font: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A TrueType or OpenType font.", rich_help_panel=TEXT)
    ] = None,
    logo: Annotated[
        Path | None, typer.Option(metavar="FILE", help="An SVG, alone or beside the text.", rich_help_panel=TEXT)
    ] = None,
    qr: Annotated[
        str | None, typer.Option(metavar="URL", help="A QR code in place of a logo.", rich_help_panel=TEXT)
    ] = None,
    logo_position: Annotated[
        LogoPosition, typer.Option(help="Of logo or QR code by the text.", rich_help_panel=TEXT)
    ] = LogoPosition.LEFT,
    preset: Annotated[
        Preset, typer.Option(help="What the other options begin with.", rich_help_panel=MARKS)
    ] = Preset.MERCHANDISE,
    strength: Annotated[
        Strength, typer.Option(help="From few small marks to large ones.", rich_help_panel=MARKS)
    ] = Strength.STANDARD,
    mode: Annotated[Mode, typer.Option(help="Raised letters or sunken ones.", rich_help_panel=MARKS)] = Mode.EMBOSS,
    profile: Annotated[
        Profile | None,
        typer.Option(
            help="Letters that rise smoothly, or with level tops and edges; default: the preset's.",
            rich_help_panel=MARKS,
        ),
    ] = None,
    color: Annotated[
        str | None,
        typer.Option(
            metavar='auto|none|"#rrggbb",...',
            help="Of the letters; of several, or of auto's, the one that stands out best; default: the preset's.",
            rich_help_panel=MARKS,
        ),
    ] = None,
    count: Annotated[
        int | None, typer.Option(metavar="N", help="The most marks to place.", rich_help_panel=MARKS)
    ] = None,
    size: Annotated[
        float | None,
        typer.Option(
            metavar="W", help="Greatest width of the text; the asset's largest side is 30.", rich_help_panel=MARKS
        ),
    ] = None,
    size_exact: Annotated[
        bool | None, typer.Option("--size-exact", help="All marks as wide as --size.", rich_help_panel=MARKS)
    ] = None,
    relief: Annotated[
        float | None,
        typer.Option(metavar="H", help="Height of the letters, in the same units.", rich_help_panel=MARKS),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of every random draw.", rich_help_panel=MARKS)] = 0,
    keep_out: Annotated[
        list[str] | None,
        typer.Option(metavar="REGION", help=f"Where no mark may stand: {REGION}", rich_help_panel=PLACES),
    ] = None,
    prefer: Annotated[
        list[str] | None,
        typer.Option(metavar="REGION", help="Where they should rather stand, likewise.", rich_help_panel=PLACES),
    ] = None,
    unmarked_copies: Annotated[
        UnmarkedCopies,
        typer.Option(help="Scenes, levels of detail and unused meshes that cannot be marked.", rich_help_panel=PLACES),
    ] = UnmarkedCopies.LEAVE_OUT,
    label: Annotated[
        Label | None,
        typer.Option(help="Write a machine-readable label, by a place's rules.", rich_help_panel=LABEL),
    ] = None,
    declaration: Annotated[
        Path | None,
        typer.Option(metavar="D.json", help="Statements about the model for it.", rich_help_panel=LABEL),
    ] = None,
    metadata_only: Annotated[
        bool, typer.Option("--metadata-only", help="Write the label, and no mark.", rich_help_panel=LABEL)
    ] = False,
    report: Annotated[
        Path | None, typer.Option(metavar="R.json", help="Write the report here.", rich_help_panel=RESULTS)
    ] = None,
    preview: Annotated[
        Path | None, typer.Option(metavar="P.png", help="Draw eight views here.", rich_help_panel=RESULTS)
    ] = None,
    file_format: Annotated[
        FileFormat | None,
        typer.Option(
            "--format",
            help="Write this format too, beside OUT.glb; default: as OUT's ending says.",
            rich_help_panel=RESULTS,
        ),
    ] = None,
    turntable: Annotated[
        Path | None,
        typer.Option(metavar="T.webp", help="Draw the result as it turns once, animated.", rich_help_panel=RESULTS),
    ] = None,
    poster: Annotated[
        Path | None, typer.Option(metavar="P.webp", help="Draw the turntable's first frame.", rich_help_panel=RESULTS)
    ] = None,
    evaluate: Annotated[
        Evaluate | None,
        typer.Option(help="Which metrics to measure; default: full with --report, else none.", rich_help_panel=RESULTS),
    ] = None,
    copies: Annotated[
        Path | None,
        typer.Option(
            metavar="T.csv",
            help="A copy of each file for each line, with its own `text`, all at the same places.",
            rich_help_panel=MANY,
        ),
    ] = None,
    preview_model: Annotated[
        Path | None,
        typer.Option(
            metavar="L.glb", help="Write a light model for public display, with the same marks.", rich_help_panel=LIGHT
        ),
    ] = None,
    preview_triangles: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="The most triangles that it keeps; letters come on top; default: 20,000.",
            rich_help_panel=LIGHT,
        ),
    ] = None,
    preview_texture: Annotated[
        int | None,
        typer.Option(
            metavar="PIXELS", help="The longer side of its images, at most; default: 512.", rich_help_panel=LIGHT
        ),
    ] = None,
    preview_alone: Annotated[
        bool, typer.Option("--preview-alone", help="Write it in the place of OUT.glb.", rich_help_panel=LIGHT)
    ] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> Status:
    """Watermark one file, or many.

    One: IN and OUT.glb are files, or - for standard input and output. Many: each IN is a file, a folder or a glob in
    quotes; every file of an accepted format is marked, and one that fails does not stop the others.

    Accepted are GLB, glTF, OBJ, STL, PLY, OFF, 3MF and DAE; with their other files as a ZIP. Results are GLB, or what
    the ending of OUT says: .stl, .ply, .3mf, or .zip for an OBJ with its materials.
    """
    if out is not None and len(paths) == 1 and out.suffix.lower() in (".glb", *ENDINGS) and not out.is_dir():
        paths, out = [*paths, out], None
    given = locals()
    written = report, preview, turntable, poster, preview_model
    source = result = None
    _require_copies(copies, out, text)
    if out is None:
        source, result = _pair(paths)
        require_streams([source, font, logo, declaration], [result, *written], as_json=json)
    else:
        require_streams([font, logo, declaration, copies], [])
        _require_folders([out, *written])
    given["format"] = file_format or (format_of(result) if result else None)
    parameters = parameters_of(given)
    style = Style(parameters, read_file(font) if font else None, read_file(logo) if logo else None)
    telling = Telling(quiet, json)
    if source and result:
        parameters.require_content(logo is not None)
        return mark_one(Order(source, result, *written), style, telling)
    assert out is not None
    folders = Folders(out, *written)
    if copies is not None:
        wanted = orders(paths, folders, read_texts(copies, parameters, logo is not None))
        return mark_many(wanted, style, jobs, telling, out / INDEX)
    parameters.require_content(logo is not None)
    return mark_many(orders(paths, folders), style, jobs, telling)


def format_of(result: Path) -> FileFormat:
    """The format that the ending of a result's name stands for.

    Raises:
        MeshmarkError: ``invalid_request`` for an OBJ, which is several files.
    """
    ending = result.suffix.lower()
    if ending == ".obj":
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            f"{result} would be one file, but an OBJ comes with its materials and textures.",
            f"Name a ZIP of them: {result.with_suffix('.zip')}.",
        )
    return ENDINGS.get(ending, FileFormat.GLB)


def parameters_of(options: dict[str, Any]) -> Parameters:
    """The parameters that the options ask for; those that are None are not given.

    Raises:
        MeshmarkError: ``empty_text`` or ``invalid_parameters``; ``missing_file`` for a declaration that is not there.
    """
    given = {name: value for name, value in options.items() if name in Parameters.model_fields and value is not None}
    # Without a report the metrics, which take seconds, would not be seen.
    given.setdefault("evaluate", Evaluate.FULL if options["report"] else Evaluate.NONE)
    given["turntable"] = any(options[name] is not None for name in ("turntable", "poster"))
    given["text"] = given["text"].replace(r"\n", "\n")
    if "," in given.get("color", ""):
        given["color"] = given["color"].split(",")
    for name in ("keep_out", "prefer"):
        given[name] = [_region(text) for text in given.get(name, ())]
    given["preview_model"] = _preview_model(options)
    if "declaration" in given:
        given["declaration"] = _json_of(given["declaration"])
    return parse_parameters(given)


def _preview_model(options: dict[str, Any]) -> dict[str, Any] | None:
    """The preview model that options ask for.

    Raises:
        MeshmarkError: ``invalid_request`` where it has no name, or two.
    """
    path, alone = options["preview_model"], options["preview_alone"]
    sizes = {name: options[f"preview_{name}"] for name in ("triangles", "texture")}
    sizes = {name: size for name, size in sizes.items() if size is not None}
    if path is not None and alone:
        problem = "With `--preview-alone` the result is the preview model, and `--preview-model` names another."
    elif sizes and path is None and not alone:
        problem = "`--preview-triangles` and `--preview-texture` are of a preview model, and none is asked for."
    else:
        return sizes | {"alone": alone} if path is not None or alone else None
    raise MeshmarkError(
        ErrorCode.INVALID_REQUEST, problem, "Ask for one of `--preview-model L.glb` and `--preview-alone`."
    )


def _region(text: str) -> dict[str, Any]:
    """The region of ``node=Head``; it is validated with all other parameters."""
    kind, _, value = text.partition("=")
    if kind == "box":
        return {kind: {"min": value.split(",")[:3], "max": value.split(",")[3:]}}
    return {kind: value}


def _json_of(path: Path) -> Any:
    try:
        return json.loads(read_file(path))
    except ValueError as error:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS, f"{path} cannot be read as JSON ({error}).", "Give a file with a JSON object."
        ) from None


def _require_folders(folders: list[Path | None]) -> None:
    """Refuse standard output in the place of a folder.

    Raises:
        MeshmarkError: ``invalid_request``.
    """
    if STANDARD in folders:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "With `--out`, results lie in folders, not on standard output.",
            "Name folders, or mark one file: `meshmark apply - - < in.glb > out.glb`.",
        )


def _require_copies(copies: Path | None, out: Path | None, text: str) -> None:
    """Refuse copies without a folder for them, and beside a text of all.

    Raises:
        MeshmarkError: ``invalid_request``.
    """
    if copies is not None and (out is None or text):
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "`--copies` goes with `--out`, and takes the place of `--text`.",
            "Name a folder for the copies, and write their texts into the list: `meshmark apply IN --out DIR --copies "
            "texts.csv`.",
        )


def _pair(paths: list[Path]) -> tuple[Path, Path]:
    """The one input and the one output.

    Raises:
        MeshmarkError: ``invalid_request``.
    """
    if len(paths) == 1:
        problem = "OUT.glb is missing."
    elif len(paths) > 2:
        problem = f"{len(paths)} files are named, and no folder for the results."
    elif paths[0].is_dir():
        problem = f"{paths[0]} is a folder."
    else:
        return paths[0], paths[1]
    raise MeshmarkError(
        ErrorCode.INVALID_REQUEST,
        problem,
        "Name one file and then its result, or with `--out` the folder for many. See `meshmark apply --help`.",
    )
