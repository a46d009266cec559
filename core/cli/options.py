"""Options that several commands share."""

from typing import Annotated

import typer

from core.cli.help_page import OUTPUT

ACCEPTED = "GLB, glTF, OBJ, STL, PLY, OFF, 3MF or DAE; with its other files as a ZIP; - for standard input"

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Tell of errors only.", rich_help_panel=OUTPUT)]
Json = Annotated[
    bool, typer.Option("--json", help="Print the outcome as JSON on standard output.", rich_help_panel=OUTPUT)
]
Seed = Annotated[int, typer.Option(help="Seed of every random draw.")]


def names(text: str) -> tuple[str, ...]:
    """The names of ``a,b``."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def numbers(text: str) -> tuple[int, ...]:
    """The numbers of ``1,2``.

    Raises:
        typer.BadParameter: for anything else.
    """
    try:
        return tuple(int(number) for number in names(text))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is no list of whole numbers.") from None
