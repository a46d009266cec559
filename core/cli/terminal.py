"""Words on the terminal: results on standard output, errors on standard error, in colour where a person reads them.

rich is loaded only where there is a terminal: elsewhere lines are plain.
"""

import json
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TextIO

from core.errors import ErrorCode, MeshmarkError

if TYPE_CHECKING:
    from rich.console import Console

# Control characters, with which names in a hostile file could steer the terminal, and halves of surrogate pairs.
_UNPRINTABLE = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\ud800-\udfff]")


def printable(text: str) -> str:
    """``text`` with what is not printed as its escape; line feeds stay."""
    return _UNPRINTABLE.sub(lambda found: found[0].encode("unicode_escape", "surrogatepass").decode(), text)


def console(stream: TextIO) -> "Console":
    """A rich console on a stream; it minds NO_COLOR and TERM."""
    from rich.console import Console
    from rich.theme import Theme

    theme = Theme({"progress.percentage": "default", "progress.elapsed": "dim"})
    return Console(file=stream, highlight=False, soft_wrap=True, theme=theme)


def say(text: str, stream: TextIO | None = None, *, style: str = "") -> None:
    """Print a line, in ``style`` on a terminal; on standard output if no stream is given."""
    stream = stream or sys.stdout
    if style and stream.isatty():
        from rich.text import Text

        console(stream).print(Text(printable(text), style))
    else:
        print(printable(text), file=stream, flush=True)


def say_error(error: MeshmarkError, about: str = "") -> None:
    """Print code and sentence of an error, and on another line its remedy, on standard error.

    Args:
        error: to be told.
        about: name of the file, where there are several; it is told unless the sentence has it.
    """
    before = f"{about}: " if about and about not in error.message else ""
    if sys.stderr.isatty():
        from rich.text import Text

        parts = [("meshmark: ", "dim"), (f"{error.code}: ", "bold red"), (printable(before + error.message), "bold")]
        console(sys.stderr).print(Text.assemble(*parts, "\n", (printable(error.remedy), "")))
    else:
        print(printable(f"meshmark: {error.code}: {before}{error.message}\n{error.remedy}"), file=sys.stderr)


def unhandled(error: Exception) -> MeshmarkError:
    """The error that tells of one which nobody meant to raise."""
    return MeshmarkError(
        ErrorCode.INTERNAL_ERROR,
        f"This case is not handled ({type(error).__name__}: {error}).",
        "Report it with the trace, and with the file if you may.",
    )


def say_json(content: Any) -> None:
    """Print a result for programs."""
    print(json.dumps(content, indent=2))


def as_json(error: MeshmarkError) -> dict[str, str]:
    """An error for programs."""
    return {"code": error.code.value, "message": error.message, "remedy": error.remedy}


@dataclass(frozen=True)
class Column:
    """A column of a table: its heading, and whether it holds numbers."""

    heading: str
    right: bool = False


def say_table(columns: Sequence[Column], rows: Sequence[Sequence[str]], styles: Sequence[str]) -> None:
    """Print a table on standard output.

    Args:
        columns: of the table.
        rows: the cells, by row.
        styles: of the rows' last cells, on a terminal.
    """
    cells = [[printable(cell) for cell in row] for row in rows]
    if sys.stdout.isatty():
        from rich import box
        from rich.table import Table
        from rich.text import Text

        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
        for column in columns:
            table.add_column(column.heading, justify="right" if column.right else "left", overflow="fold")
        for row, style in zip(cells, styles, strict=True):
            table.add_row(*map(Text, row[:-1]), Text(row[-1], style))
        console(sys.stdout).print(table, soft_wrap=False)
        return
    lines = [[column.heading for column in columns], *cells]
    widths = [max(len(line[place]) for line in lines) for place in range(len(columns))]
    for line in lines:
        padded = (
            cell.rjust(width) if column.right else cell.ljust(width)
            for cell, width, column in zip(line, widths, columns, strict=True)
        )
        print("  ".join(padded).rstrip())


@dataclass(frozen=True)
class Item:
    """A line of a list: a word in a colour, a name, a sentence, and a dim one below that where there is more to say."""

    word: str
    style: str
    name: str
    sentence: str
    more: str = ""


def say_list(items: Sequence[Item]) -> None:
    """Print a list on standard output, in columns."""
    if sys.stdout.isatty():
        from rich.table import Table
        from rich.text import Text

        table = Table.grid(padding=(0, 2))
        for item in items:
            said = Text(printable(item.sentence))
            if item.more:
                said.append(f"\n{printable(item.more)}", "dim")
            table.add_row(Text(item.word, item.style), Text(item.name, "bold"), said)
        console(sys.stdout).print(table, soft_wrap=False)
        return
    words, names = (max(len(cell) for cell in cells) for cells in zip(*((i.word, i.name) for i in items), strict=True))
    for item in items:
        say(f"{item.word:{words}}  {item.name:{names}}  {item.sentence}")
        if item.more:
            say(f"{'':{words}}  {'':{names}}  {item.more}")
