"""The command `meshmark evaluate`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from core.choices import Evaluate
from core.cli.files import read_file, require_streams, write_json
from core.cli.options import ACCEPTED, Json, Quiet, Seed
from core.cli.progress import progress
from core.cli.terminal import say, say_json


class Level(StrEnum):
    """Levels of metrics, of which a measurement has at least one."""

    FULL = Evaluate.FULL.value
    GEOMETRY = Evaluate.GEOMETRY.value


def evaluate(
    original: Annotated[Path, typer.Argument(metavar="ORIGINAL", help=f"{ACCEPTED}.")],
    watermarked: Annotated[Path, typer.Argument(metavar="WATERMARKED", help="The same, in the same coordinates.")],
    report: Annotated[Path, typer.Option(metavar="R.json", help="Write the report here; - for standard output.")],
    watermarks: Annotated[
        Path | None,
        typer.Option(
            metavar="W.json",
            help="Where they stand: a report, or a list of {center, up, normal, size, relief, text} in the original's "
            "coordinates. Without it, what needs them stays null.",
        ),
    ] = None,
    text: Annotated[str, typer.Option(metavar="T", help="What they say; default: what W.json says.")] = "",
    evaluate: Annotated[Level, typer.Option(help="Which metrics to measure.")] = Level.FULL,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Measure a watermarked file against its original, whoever watermarked it."""
    require_streams([original, watermarked, watermarks], [report], as_json=json)
    files = read_file(original), read_file(watermarked)
    with progress(str(watermarked), quiet=quiet) as tell:
        if tell is not None:
            tell("measuring", None)
        from core.evaluate import evaluate as measure
        from core.evaluate import parse_watermarks

        places = parse_watermarks(read_file(watermarks)) if watermarks else []
        found = measure(*files, places, text, Evaluate(evaluate), seed)
    write_json(report, found)
    if json:
        say_json(found)
    elif not quiet and str(report) != "-":
        metrics = found["metrics"]
        for name, value in (metrics["watermark_quality"] | metrics["asset_utility"]).items():
            missing = metrics["missing"].get(name)
            say(f"{name:20}{missing['message'] if missing else format(value, '.4g')}")
