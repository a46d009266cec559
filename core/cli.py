"""``meshmark``: the engine on the command line."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any, TypeAlias

from core import __version__, process
from core.cli_files import read_file, write_file
from core.cli_text import add_label_options, add_text_options
from core.cli_verify import add_verify
from core.errors import ErrorCode, MeshmarkError
from core.lab.benchmark.datasets import LAYOUTS
from core.lab.benchmark.options import OBJECTIVE_METHODS, BenchmarkOptions, attack_requests
from core.parameters import Evaluate, Mode, Parameters, Preset, UnmarkedCopies, parse_parameters

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"

ACCEPTED = "GLB, glTF, OBJ, STL, PLY, OFF, 3MF or DAE; with its other files as a ZIP"


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; returns the exit status: 0 done, 1 failed, 2 wrong usage."""
    process.before_command()
    options = parser().parse_args(arguments)
    try:
        options.run(options)
    except MeshmarkError as error:
        print(f"meshmark: {error.code}: {error.message}\n{error.remedy}", file=sys.stderr)
        return 1
    return 0


def parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    top = argparse.ArgumentParser(prog="meshmark", description="Emboss visible watermarks into 3D assets.")
    top.add_argument("--version", action="version", version=f"meshmark {__version__}")
    commands = top.add_subparsers(dest="command", required=True)
    _add_apply(commands)
    _add_evaluate(commands)
    add_verify(commands)
    _add_attack(commands)
    _add_benchmark(commands)
    _add_profile(commands)
    _add_sizing(commands)
    _add_models(commands)
    return top


def _add_apply(commands: Commands) -> None:
    apply = commands.add_parser("apply", help="watermark one file", description="Watermark one file.")
    apply.set_defaults(run=_apply)
    apply.add_argument("input", type=Path, metavar="IN", help=ACCEPTED)
    apply.add_argument("output", type=Path, metavar="OUT.glb", help="the watermarked GLB")
    add_text_options(apply)
    add_label_options(apply)
    apply.add_argument("--font", type=Path, help="a TrueType or OpenType font file")
    apply.add_argument("--report", type=Path, metavar="R.json", help="write the report here")
    apply.add_argument("--preview", type=Path, metavar="P.png", help="render eight views here")
    apply.add_argument("--preset", choices=[preset.value for preset in Preset], default=Preset.MERCHANDISE.value)
    apply.add_argument("--mode", choices=[mode.value for mode in Mode], default=Mode.EMBOSS.value)
    apply.add_argument("--relief", type=float, metavar="H", help="height of the letters, in the same units")
    apply.add_argument("--count", type=int, metavar="N", help="the most watermarks to place")
    apply.add_argument(
        "--color",
        type=_colors,
        metavar='auto|none|"#rrggbb"[,"#rrggbb"]...',
        help="letter colour; of several, or of a built-in list, the one that stands out best (default: the preset's)",
    )
    apply.add_argument("--seed", type=int, default=0, help="seed of every random draw (default 0)")
    for name, meaning in (
        ("--keep-out", "where no watermark may stand"),
        ("--prefer", "where they should rather stand"),
    ):
        apply.add_argument(
            name,
            type=_region,
            action="append",
            default=[],
            metavar="node=NAME|material=NAME|box=X,Y,Z,X,Y,Z",
            help=f"{meaning}; a box from its lowest to its highest corner, in the asset's coordinates; may be repeated",
        )
    apply.add_argument(
        "--unmarked-copies",
        choices=[choice.value for choice in UnmarkedCopies],
        default=UnmarkedCopies.LEAVE_OUT.value,
        help="scenes, levels of detail and unused meshes that cannot be marked (default %(default)s)",
    )
    apply.add_argument(
        "--evaluate",
        choices=[level.value for level in Evaluate],
        help="which metrics to measure (default: full with --report, else none)",
    )


def _colors(text: str) -> str | list[str]:
    return text.split(",") if "," in text else text


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


def _add_attack(commands: Commands) -> None:
    attack = commands.add_parser(
        "attack",
        help="damage a watermarked file as a thief would",
        description="Damage a watermarked file as a thief would. Only plain geometry comes out.",
        epilog="Attacks: crop, removal, remesh, decimate, subdivide, rotate, translate, scale, noise, smooth and "
        "reexport. What a strength means is said when one is out of range.",
    )
    attack.set_defaults(run=_attack)
    attack.add_argument("name", metavar="NAME", help="which attack")
    attack.add_argument("input", type=Path, metavar="IN", help=ACCEPTED)
    attack.add_argument("output", type=Path, metavar="OUT.glb", help="what is left")
    attack.add_argument("--strength", type=float, metavar="S", help="default: as in the paper where it has one")
    attack.add_argument("--seed", type=int, default=0, help="seed of every random draw (default 0)")
    attack.add_argument("--original", type=Path, help="the file without watermarks; removal needs it to find letters")


def _add_benchmark(commands: Commands) -> None:
    benchmark = commands.add_parser(
        "benchmark",
        help="compare methods over a folder of assets",
        description="Watermark, attack and measure every asset by every method; write the paper's tables and plots.",
    )
    benchmark.set_defaults(run=_benchmark)
    known = BenchmarkOptions(Path(), Path())
    benchmark.add_argument("folder", type=Path, metavar="DIR", help="the assets")
    benchmark.add_argument("--out", type=Path, metavar="OUT", required=True, help="rows, tables, plots; resumes there")
    benchmark.add_argument("--dataset", default=known.dataset, choices=LAYOUTS, help="how DIR is laid out")
    benchmark.add_argument("--split", default=known.split, help="of a dataset that is split (default %(default)s)")
    benchmark.add_argument("--samples", type=int, metavar="N", help="draw so many assets, stratified by class")
    benchmark.add_argument(
        "--methods",
        type=_names,
        default=known.methods,
        metavar="M,...",
        help="meshmark, meshmark-default, li, paper, paper-no-curve-matching, paper-no-optimization, "
        "paper-no-filtering, invisible (default: all); meshmark-flat, -discreet, -strong",
    )
    benchmark.add_argument("--counts", type=_numbers, default=known.counts, metavar="N,...", help="default 4,16,32")
    benchmark.add_argument(
        "--attacks",
        type=_names,
        default=(),
        metavar="A[:STRENGTH],...",
        help="see `meshmark attack --help`; all is crop,removal,remesh,decimate,subdivide; "
        "thief is what those try who have only the marked file",
    )
    benchmark.add_argument(
        "--attack-counts", type=_numbers, default=(), metavar="N,...", help="default: the middle one of --counts"
    )
    benchmark.add_argument("--text", default=known.text, help="default %(default)s")
    benchmark.add_argument(
        "--size", type=float, metavar="W", help="text width; default: 5.5, and what fits for meshmark"
    )
    benchmark.add_argument("--relief", type=float, metavar="H", help="height of letters; default: 0.04 text widths")
    benchmark.add_argument("--color", metavar='"#rrggbb"', help="ask Meshmark for it; OCR reads these letters, too")
    benchmark.add_argument("--level", choices=[Evaluate.FULL.value, Evaluate.GEOMETRY.value], default=known.level.value)
    benchmark.add_argument("--views", type=int, default=known.views, help="of the 24 views (default %(default)s)")
    benchmark.add_argument(
        "--resolution", type=int, default=known.resolution, metavar="PIXELS", help="default %(default)s"
    )
    benchmark.add_argument("--seed", type=int, default=known.seed, help="default %(default)s")
    benchmark.add_argument(
        "--processes", type=int, default=known.processes, metavar="P", help="assets at once (default %(default)s)"
    )
    benchmark.add_argument("--row-seconds", type=float, default=known.row_seconds, help="longest step (%(default)s)")
    benchmark.add_argument("--retry-failed", action="store_true", help="run failed rows again")
    benchmark.add_argument("--report-only", action="store_true", help="write tables and plots of the rows in OUT")


def _add_profile(commands: Commands) -> None:
    profile = commands.add_parser(
        "profile",
        help="where the seconds of our own method go, over a folder of assets",
        description="Time every stage over a folder of assets: against their faces, and against reading and writing "
        "alone. Prints Markdown tables.",
    )
    profile.set_defaults(run=_profile)
    profile.add_argument("folder", type=Path, metavar="DIR", help="the assets, at any depth")
    profile.add_argument("--out", type=Path, metavar="OUT", help="write PROFILE.md and profile.json there")
    profile.add_argument(
        "--repeats", type=int, default=1, metavar="N", help="run each asset N times, the quickest counts (default 1)"
    )
    profile.add_argument("--metrics", action="store_true", help="time the preview and all metrics too")


def _add_sizing(commands: Commands) -> None:
    sizing = commands.add_parser(
        "sizing",
        help="how many workers so many uploads take",
        description="Simulate a queue before workers that take as long as a profile says. Prints a Markdown table.",
    )
    sizing.set_defaults(run=_sizing)
    sizing.add_argument(
        "--profile", type=Path, required=True, metavar="profile.json", help="what `meshmark profile` wrote"
    )
    sizing.add_argument("--arrivals", type=_numbers, required=True, metavar="N,...", help="uploads an hour")
    sizing.add_argument(
        "--mix", default="inf:1", metavar="FACES:SHARE,...", help="shares by faces (default: every asset alike)"
    )
    sizing.add_argument("--p95-wait", type=float, default=30.0, metavar="S", help="seconds (default %(default)s)")
    sizing.add_argument(
        "--busy", type=float, default=0.9, metavar="SHARE", help="most that workers may be busy (default %(default)s)"
    )
    sizing.add_argument(
        "--overhead", type=float, default=0.0, metavar="S", help="seconds of a job beside the engine (default 0)"
    )
    sizing.add_argument("--seed", type=int, default=0, help="seed of every random draw (default 0)")


def _region(text: str) -> dict[str, Any]:
    """The region of ``node=Head``; it is validated with all other parameters."""
    kind, _, value = text.partition("=")
    if kind == "box":
        return {kind: {"min": value.split(",")[:3], "max": value.split(",")[3:]}}
    return {kind: value}


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(number) for number in _names(text))


def _add_models(commands: Commands) -> None:
    models = commands.add_parser(
        "models",
        help="weights that make the semantics score the paper's",
        description="List or fetch the weights that do not ship with Meshmark. $MESHMARK_MODELS is where they lie.",
    )
    models.set_defaults(run=_models)
    models.add_argument("what", choices=["list", "fetch"])
    models.add_argument("name", nargs="?", metavar="NAME", help="which; default: all")


def _apply(options: argparse.Namespace) -> None:
    # Without a report the metrics, which take seconds, would not be seen.
    options.evaluate = options.evaluate or (Evaluate.FULL if options.report else Evaluate.NONE).value
    given = {name: value for name, value in vars(options).items() if name in Parameters.model_fields}
    parameters = parse_parameters(given)
    data = read_file(options.input)
    font, logo = (read_file(path) if path else None for path in (options.font, options.logo))
    parameters.require_content(logo is not None)

    from core.pipeline import watermark  # torch and the geometry libraries take seconds: not for --help or a typo

    result = watermark(
        data,
        parameters,
        font=font,
        logo=logo,
        preview=options.preview is not None,
        progress=_show if sys.stderr.isatty() else None,
    )
    write_file(options.output, result.file.data)
    if options.report:
        write_file(options.report, (json.dumps(result.report, indent=2) + "\n").encode())
    if options.preview:
        if result.preview is None:
            warning = result.report["warnings"][-1]  # previewing is the last stage, and so is its warning
            raise MeshmarkError(ErrorCode(warning["code"]), warning["message"], warning["remedy"])
        write_file(options.preview, result.preview)
    seconds = sum(result.report["timings"].values())
    print(f"{options.output}: {len(result.report['watermarks'])} watermarks in {seconds:.1f} s")


def _evaluate(options: argparse.Namespace) -> None:
    from core.evaluate import evaluate, parse_watermarks

    report = evaluate(
        read_file(options.original),
        read_file(options.watermarked),
        parse_watermarks(read_file(options.watermarks)) if options.watermarks else [],
        options.text,
        Evaluate(options.evaluate),
        options.seed,
    )
    write_file(options.report, (json.dumps(report, indent=2) + "\n").encode())
    metrics = report["metrics"]
    for name, value in (metrics["watermark_quality"] | metrics["asset_utility"]).items():
        missing = metrics["missing"].get(name)
        print(f"{name:20}{missing['message'] if missing else format(value, '.4g')}")


def _attack(options: argparse.Namespace) -> None:
    from core.lab.attacks.attack import attack_file

    original = read_file(options.original) if options.original else None
    left = attack_file(read_file(options.input), options.name, options.strength, options.seed, original)
    write_file(options.output, left)
    print(f"{options.output}: {len(left):,} bytes")


def _benchmark(options: argparse.Namespace) -> None:
    from core.lab.benchmark.run import run

    settings = {name: getattr(options, name) for name in BenchmarkOptions.__dataclass_fields__}
    settings["methods"] = OBJECTIVE_METHODS if options.methods == ("objective",) else options.methods
    settings["attacks"] = attack_requests(options.attacks)
    rows = run(BenchmarkOptions(**settings | {"level": Evaluate(options.level)}))
    failed = sum(row["status"] != "ok" for row in rows)
    print(f"{options.out / 'REPORT.md'}: {len(rows)} rows, {failed} of them refused or failed")


def _profile(options: argparse.Namespace) -> None:
    from core.lab.benchmark.profile import markdown, profile, write_profile

    found = profile(
        options.folder,
        repeats=options.repeats,
        evaluate=Evaluate.FULL if options.metrics else Evaluate.NONE,
        progress=_show if sys.stderr.isatty() else None,
    )
    print(markdown(found), end="")
    if options.out:
        write_profile(found, options.out)


def _sizing(options: argparse.Namespace) -> None:
    from core.lab.benchmark.queueing import Effort
    from core.lab.benchmark.sizing import markdown, parse_mix, sizing

    try:
        profile = json.loads(read_file(options.profile))
    except ValueError:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS, f"{options.profile} is no JSON.", "Give what `meshmark profile` wrote."
        ) from None
    mix, wait, effort = parse_mix(options.mix), options.p95_wait, Effort(seed=options.seed)
    rest = {name: getattr(options, name) for name in ("busy", "overhead")}
    found = sizing(profile, options.arrivals, mix=mix, wait=wait, effort=effort, **rest)
    print(markdown(found, wait, options.busy), end="")


def _models(options: argparse.Namespace) -> None:
    from core.models import fetch, listing

    for listed in listing():
        name = listed.model.name
        if options.name in (None, name):
            if options.what == "fetch":
                print(fetch(name, progress=_show_bytes if sys.stderr.isatty() else None))
            else:
                print(f"{name:24}{listed.state:12}{listed.model.size:>12,} bytes  {listed.path}")
    if options.name not in (None, *(listed.model.name for listed in listing())):
        fetch(options.name)  # says that there is none of that name


def _show_bytes(done: int, total: int) -> None:
    _show(f"{done:,} of {total:,} bytes", done / total)


def _show(stage: str, share: float) -> None:
    end = "\n" if share >= 1 else ""
    print(f"\r\033[K{share:4.0%} {stage}", end=end, file=sys.stderr, flush=True)
