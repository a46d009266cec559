"""The command `meshmark study`."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from core.cli.options import Json, Quiet, names
from core.cli.progress import Progress, progress
from core.cli.terminal import say, say_json
from core.errors import ErrorCode, MeshmarkError

if TYPE_CHECKING:
    from core.lab.study.trials import Trial

USAGE = "RESULTS --out STUDY.html | KEY.json ANSWERS.json..."
PAGE = "The page"
EPILOG = """Examples:

meshmark study results --out study.html --methods meshmark,li --assets 20
meshmark study study.key.json answers/*.json"""


def study(
    paths: Annotated[list[Path], typer.Argument(metavar="RESULTS", hidden=True)],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="STUDY.html", help="Write the page here.", rich_help_panel=PAGE),
    ] = None,
    methods: Annotated[
        str, typer.Option(metavar="A,B", help="Of the benchmark, to be compared.", rich_help_panel=PAGE)
    ] = "meshmark,li",
    count: Annotated[
        int | None,
        typer.Option(metavar="N", help="Marks asked for; default: the benchmark's middle one.", rich_help_panel=PAGE),
    ] = None,
    assets: Annotated[int, typer.Option(metavar="N", min=1, help="Most assets to show.", rich_help_panel=PAGE)] = 20,
    seed: Annotated[int, typer.Option(help="Seed of every random draw.", rich_help_panel=PAGE)] = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Ask people about two methods, and count their answers.

    With --out: a page that shows the assets of a benchmark as two methods marked them, without a word about which is
    which, and asks the paper's six questions; its key lies beside it. Else: the Markdown table of the answers that
    people saved from that page.
    """
    if out is None:
        _count(paths[0], paths[1:], as_json=json)
        return
    if len(paths) > 1 or len(names(methods)) != 2:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "A page shows two methods over one benchmark's results.",
            "Name one folder that `meshmark benchmark --out` wrote, and `--methods A,B`.",
        )
    from core.lab.study.page import write_study
    from core.lab.study.trials import chosen_rows, read_results, trials

    first, second = names(methods)
    options, rows = read_results(paths[0])
    number, wanted = chosen_rows(rows, (first, second), count)
    with progress(str(paths[0]), quiet=quiet) as tell:
        shown = trials(options, rows, (first, second), number, assets, seed)
        key, made = write_study(_told(shown, tell, min(assets, len(wanted))), out, number)
    if json:
        say_json({"page": str(out), "key": str(key), "trials": made})
    elif not quiet:
        say(f"{out}: {made} trials; keep {key} to yourself until the answers are in")


def _told(shown: "Iterator[Trial]", tell: Progress | None, total: int) -> "Iterator[Trial]":
    """The same trials, of each of which it is told when it is there."""
    for place, trial in enumerate(shown, 1):
        if tell is not None:
            tell(trial.asset, place / total)
        yield trial


def _count(key: Path, answers: list[Path], *, as_json: bool) -> None:
    from core.lab.study.answers import read_answers, read_key, tally

    known = read_key(key)
    if not answers:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "There are no answers to count.",
            "Give the files that the page of the study saved, or with `--out` a page to write.",
        )
    table = tally(known, [read_answers(path, known) for path in answers])
    if as_json:
        say_json({"people": len(answers), "table": table})
    else:
        print(table, end="")
