"""The command `meshmark benchmark`."""

from pathlib import Path
from typing import Annotated

import typer

from core.choices import Evaluate
from core.cli.evaluate import Level
from core.cli.options import Json, names, numbers
from core.cli.terminal import say, say_json
from core.lab.benchmark.options import OBJECTIVE_METHODS, BenchmarkOptions, attack_requests

KNOWN = BenchmarkOptions(Path(), Path())
LEVEL = Level(KNOWN.level.value)
LEVEL = Level(KNOWN.level.value)
ASSETS, COMPARED, MARKS, MEASURED, RUN = "Assets", "Methods and attacks", "Marks", "Measured", "Run"


def benchmark(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The assets.")],
    out: Annotated[Path, typer.Option(metavar="OUT", help="Rows, tables, plots; resumes there.")],
    dataset: Annotated[
        str,
        typer.Option(
            metavar="folder|manifold40|modelnet40|objaverse|meshy",
            help="How DIR is laid out.",
            rich_help_panel=ASSETS,
        ),
    ] = KNOWN.dataset,
    split: Annotated[
        str, typer.Option(metavar="train|test", help="Of a dataset that is split.", rich_help_panel=ASSETS)
    ] = KNOWN.split,
    samples: Annotated[
        int | None,
        typer.Option(metavar="N", help="Draw so many assets, stratified by class.", rich_help_panel=ASSETS),
    ] = KNOWN.samples,
    methods: Annotated[
        str,
        typer.Option(
            metavar="M,...",
            help="meshmark, meshmark-default, li, paper, paper-no-curve-matching, paper-no-optimization, "
            "paper-no-filtering, invisible (default: these); meshmark-flat, meshmark-discreet, meshmark-strong.",
            rich_help_panel=COMPARED,
            show_default=False,
        ),
    ] = ",".join(KNOWN.methods),
    counts: Annotated[
        str, typer.Option(metavar="N,...", help="Numbers of marks.", rich_help_panel=COMPARED)
    ] = ",".join(map(str, KNOWN.counts)),
    attacks: Annotated[
        str,
        typer.Option(
            metavar="A[:STRENGTH],...",
            help="See `meshmark attack --help`; all is crop,removal,remesh,decimate,subdivide; thief is what those try "
            "who have only the marked file.",
            rich_help_panel=COMPARED,
            show_default=False,
        ),
    ] = "",
    attack_counts: Annotated[
        str,
        typer.Option(
            metavar="N,...", help="Default: the middle one of --counts.", rich_help_panel=COMPARED, show_default=False
        ),
    ] = "",
    text: Annotated[str, typer.Option(metavar="T", help="What to emboss.", rich_help_panel=MARKS)] = KNOWN.text,
    size: Annotated[
        float | None,
        typer.Option(metavar="W", help="Text width; default: 5.5, and what fits for meshmark.", rich_help_panel=MARKS),
    ] = KNOWN.size,
    relief: Annotated[
        float | None,
        typer.Option(metavar="H", help="Height of letters; default: 0.04 text widths.", rich_help_panel=MARKS),
    ] = KNOWN.relief,
    color: Annotated[
        str | None,
        typer.Option(
            metavar='"#rrggbb"', help="Ask Meshmark for it; OCR reads these letters, too.", rich_help_panel=MARKS
        ),
    ] = KNOWN.color,
    level: Annotated[Level, typer.Option(help="Which metrics to measure.", rich_help_panel=MEASURED)] = LEVEL,
    views: Annotated[int, typer.Option(metavar="N", help="Of the 24 views.", rich_help_panel=MEASURED)] = KNOWN.views,
    resolution: Annotated[
        int, typer.Option(metavar="PIXELS", help="Of the pictures.", rich_help_panel=MEASURED)
    ] = KNOWN.resolution,
    seed: Annotated[int, typer.Option(help="Seed of every random draw.", rich_help_panel=RUN)] = KNOWN.seed,
    processes: Annotated[int, typer.Option(metavar="P", help="Assets at once.", rich_help_panel=RUN)] = KNOWN.processes,
    row_seconds: Annotated[
        float, typer.Option(metavar="S", help="Longest step.", rich_help_panel=RUN)
    ] = KNOWN.row_seconds,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Run failed rows again.", rich_help_panel=RUN)
    ] = False,
    report_only: Annotated[
        bool, typer.Option("--report-only", help="Write tables and plots of the rows in OUT.", rich_help_panel=RUN)
    ] = False,
    json: Json = False,
) -> None:
    """Watermark, attack and measure every asset by every method; write the paper's tables and plots."""
    asked = {name: value for name, value in locals().items() if name in BenchmarkOptions.__dataclass_fields__}
    of_names = names(methods)
    asked |= {
        "methods": OBJECTIVE_METHODS if of_names == ("objective",) else of_names,
        "counts": numbers(counts),
        "attacks": attack_requests(names(attacks)),
        "attack_counts": numbers(attack_counts),
        "level": Evaluate(level),
    }
    from core.lab.benchmark.run import run

    rows = run(BenchmarkOptions(**asked))
    failed = sum(row["status"] != "ok" for row in rows)
    if json:
        say_json({"report": str(out / "REPORT.md"), "rows": len(rows), "failed": failed})
    else:
        say(f"{out / 'REPORT.md'}: {len(rows)} rows, {failed} of them refused or failed")
