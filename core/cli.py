"""``meshmark``: the engine on the command line."""

import argparse
import json
import sys
from pathlib import Path
from typing import TypeAlias

from core import __version__
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Evaluate, Mode, Preset, parse_parameters

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"

ACCEPTED = "GLB, glTF, OBJ, STL, PLY, OFF, 3MF or DAE; with its other files as a ZIP"


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; returns the exit status: 0 done, 1 it could not be done, 2 wrong usage."""
    options = _parser().parse_args(arguments)
    try:
        options.run(options)
    except MeshmarkError as error:
        print(f"meshmark: {error.code}: {error.message}\n{error.remedy}", file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="meshmark", description="Emboss visible watermarks into 3D assets.")
    parser.add_argument("--version", action="version", version=f"meshmark {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    _add_apply(commands)
    _add_evaluate(commands)
    return parser


def _add_apply(commands: Commands) -> None:
    apply = commands.add_parser("apply", help="watermark one file", description="Watermark one file.")
    apply.set_defaults(run=_apply)
    apply.add_argument("input", type=Path, metavar="IN", help=ACCEPTED)
    apply.add_argument("output", type=Path, metavar="OUT.glb", help="the watermarked GLB")
    apply.add_argument("--text", required=True, help="what to emboss")
    apply.add_argument("--font", type=Path, help="a TrueType or OpenType font file")
    apply.add_argument("--report", type=Path, metavar="R.json", help="write the report here")
    apply.add_argument("--preview", type=Path, metavar="P.png", help="render eight views here")
    apply.add_argument("--preset", choices=[preset.value for preset in Preset], default=Preset.MERCHANDISE.value)
    apply.add_argument("--mode", choices=[mode.value for mode in Mode], default=Mode.EMBOSS.value)
    apply.add_argument("--size", type=float, metavar="W", help="text width where the asset's largest side is 30")
    apply.add_argument("--relief", type=float, metavar="H", help="height of the letters, in the same units")
    apply.add_argument("--count", type=int, metavar="N", help="the most watermarks to place")
    apply.add_argument("--color", default="none", metavar='"#rrggbb"', help='letter colour, or "none" (default)')
    apply.add_argument("--seed", type=int, default=0, help="seed of every random draw (default 0)")
    apply.add_argument(
        "--evaluate",
        choices=[level.value for level in Evaluate],
        help="which metrics to measure (default: full with --report, else none)",
    )


def _add_evaluate(commands: Commands) -> None:
    evaluate = commands.add_parser(
        "evaluate",
        help="measure a watermarked file against its original",
        description="Measure a watermarked file against its original, whoever watermarked it.",
    )
    evaluate.set_defaults(run=_evaluate)
    evaluate.add_argument("original", type=Path, metavar="ORIGINAL", help=ACCEPTED)
    evaluate.add_argument("watermarked", type=Path, metavar="WATERMARKED", help="the same, in the same coordinates")
    evaluate.add_argument("--report", type=Path, metavar="R.json", required=True, help="write the report here")
    evaluate.add_argument(
        "--watermarks",
        type=Path,
        metavar="W.json",
        help="where they stand: a report, or a list of {center, up, normal, size, relief, text} in the original's "
        "coordinates; without it, what needs them stays null",
    )
    evaluate.add_argument("--text", default="", help="what they say; default: what W.json says")
    evaluate.add_argument("--seed", type=int, default=0, help="seed of the random samples (default 0)")
    evaluate.add_argument(
        "--evaluate", choices=[Evaluate.FULL.value, Evaluate.GEOMETRY.value], default=Evaluate.FULL.value
    )


def _apply(options: argparse.Namespace) -> None:
    names = ("text", "preset", "mode", "size", "relief", "count", "color", "seed", "evaluate")
    # Without a report nobody would see what measuring it takes seconds to find.
    options.evaluate = options.evaluate or (Evaluate.FULL if options.report else Evaluate.NONE).value
    parameters = parse_parameters({name: getattr(options, name) for name in names})
    data = _read(options.input)
    font = _read(options.font) if options.font else None

    from core.pipeline import watermark  # torch and the geometry libraries take seconds: not for --help or a typo

    result = watermark(
        data,
        parameters,
        font=font,
        preview=options.preview is not None,
        progress=_show if sys.stderr.isatty() else None,
    )
    _write(options.output, result.model)
    if options.report:
        _write(options.report, (json.dumps(result.report, indent=2) + "\n").encode())
    if options.preview:
        if result.preview is None:
            warning = result.report["warnings"][-1]  # previewing is the last stage: what kept it from it comes last
            raise MeshmarkError(ErrorCode(warning["code"]), warning["message"], warning["remedy"])
        _write(options.preview, result.preview)
    seconds = sum(result.report["timings"].values())
    print(f"{options.output}: {len(result.report['watermarks'])} watermarks in {seconds:.1f} s")


def _evaluate(options: argparse.Namespace) -> None:
    from core.evaluate import evaluate, parse_watermarks

    report = evaluate(
        _read(options.original),
        _read(options.watermarked),
        parse_watermarks(_read(options.watermarks)) if options.watermarks else [],
        options.text,
        Evaluate(options.evaluate),
        options.seed,
    )
    _write(options.report, (json.dumps(report, indent=2) + "\n").encode())
    metrics = report["metrics"]
    for name, value in (metrics["watermark_quality"] | metrics["asset_utility"]).items():
        missing = metrics["missing"].get(name)
        print(f"{name:13}{missing['message'] if missing else format(value, '.4g')}")


def _show(stage: str, share: float) -> None:
    end = "\n" if share >= 1 else ""
    print(f"\r\033[K{share:4.0%} {stage}", end=end, file=sys.stderr, flush=True)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise MeshmarkError(
            ErrorCode.MISSING_FILE, f"{path} cannot be read: {error.strerror}.", "Check the path and its permissions."
        ) from None


def _write(path: Path, data: bytes) -> None:
    """Writes beside the target and renames, so that no half-written file is ever left under its name."""
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_bytes(data)
        partial.replace(path)
    except OSError as error:
        raise MeshmarkError(
            ErrorCode.OUTPUT_NOT_WRITABLE, f"{path} cannot be written: {error.strerror}.", "Choose another place."
        ) from None
