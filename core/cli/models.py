"""The command `meshmark models`."""

from dataclasses import asdict
from enum import StrEnum
from typing import Annotated

import typer

from core.cli.options import Json, Quiet
from core.cli.progress import progress
from core.cli.terminal import say, say_json
from core.models import MODELS, Listed, fetch, listing


class What(StrEnum):
    """Things to do with models."""

    LIST = "list"
    FETCH = "fetch"


def models(
    what: Annotated[What, typer.Argument(help="What to do.")],
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="Which; default: all.", autocompletion=lambda: [*MODELS])
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """List or fetch the weights that do not ship with Meshmark. $MESHMARK_MODELS is where they lie."""
    wanted = [*MODELS] if name is None else [name]
    if what is What.FETCH or name not in (None, *MODELS):
        for wish in wanted:
            path = _fetch(wish, quiet)
            if not quiet and not json:
                say(str(path))
    listed = [each for each in listing() if each.model.name in wanted]
    if json:
        say_json({"models": [_as_json(each) for each in listed]})
    elif what is What.LIST:
        for each in listed:
            say(f"{each.model.name:24}{each.state:12}{each.model.size:>12,} bytes  {each.path}")


def _fetch(name: str, quiet: bool) -> object:
    with progress(name, quiet=quiet) as tell:
        if tell is None:
            return fetch(name)

        def of_bytes(done: int, total: int) -> None:
            assert tell is not None
            tell("fetching", done / total)

        return fetch(name, progress=of_bytes)


def _as_json(listed: Listed) -> dict[str, object]:
    return asdict(listed.model) | {"state": listed.state.value, "path": str(listed.path)}
