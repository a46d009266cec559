"""The command `meshmark sizing`."""

import json as json_text
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from core.cli.files import read_file
from core.cli.options import Json, Seed, numbers
from core.cli.terminal import say_json
from core.errors import ErrorCode, MeshmarkError


def sizing(
    profile: Annotated[Path, typer.Option(metavar="profile.json", help="What `meshmark profile` wrote.")],
    arrivals: Annotated[str, typer.Option(metavar="N,...", help="Uploads an hour.")],
    mix: Annotated[
        str, typer.Option(metavar="FACES:SHARE,...", help="Shares by faces; default: every asset alike.")
    ] = "inf:1",
    p95_wait: Annotated[float, typer.Option(metavar="S", help="Seconds that 95 % wait at most.")] = 30.0,
    busy: Annotated[float, typer.Option(metavar="SHARE", help="Most that workers may be busy.")] = 0.9,
    overhead: Annotated[float, typer.Option(metavar="S", help="Seconds of a job beside the engine.")] = 0.0,
    without: Annotated[bool, typer.Option("--without-metrics", help="Count the stages up to the model alone.")] = False,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Simulate a queue before workers that take as long as a profile says. Prints a Markdown table."""
    from core.lab.benchmark.queueing import Effort
    from core.lab.benchmark.sizing import markdown, parse_mix, without_metrics
    from core.lab.benchmark.sizing import sizing as simulate

    try:
        measured = json_text.loads(read_file(profile))
    except ValueError:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS, f"{profile} is no JSON.", "Give what `meshmark profile` wrote."
        ) from None
    measured = without_metrics(measured) if without else measured
    effort, shares = Effort(seed=seed), parse_mix(mix)
    found = simulate(
        measured, numbers(arrivals), mix=shares, wait=p95_wait, busy=busy, overhead=overhead, effort=effort
    )
    if json:
        say_json({"sizings": [asdict(each) for each in found]})
    else:
        print(markdown(found, p95_wait, busy), end="")
