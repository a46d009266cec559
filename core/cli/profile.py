"""The command `meshmark profile`."""

from pathlib import Path
from typing import Annotated

import typer

from core.choices import Evaluate
from core.cli.options import Json, Quiet
from core.cli.progress import progress
from core.cli.terminal import say_json


def profile(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The assets, at any depth.")],
    out: Annotated[Path | None, typer.Option(metavar="OUT", help="Write PROFILE.md and profile.json there.")] = None,
    repeats: Annotated[int, typer.Option(metavar="N", help="Run each asset N times; the quickest counts.")] = 1,
    metrics: Annotated[bool, typer.Option("--metrics", help="Time the preview and all metrics too.")] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Time every stage over a folder of assets: against their faces, and against reading and writing alone.

    Prints Markdown tables.
    """
    from core.lab.benchmark.profile import markdown, write_profile
    from core.lab.benchmark.profile import profile as measure

    with progress(str(folder), quiet=quiet) as tell:
        found = measure(folder, repeats=repeats, evaluate=Evaluate.FULL if metrics else Evaluate.NONE, progress=tell)
    if json:
        say_json(found)
    elif not quiet:
        print(markdown(found), end="")
    if out:
        write_profile(found, out)
