"""All commands of ``meshmark``, each in its own module, which is loaded when it is called."""

import re
import sys
import traceback
from importlib import import_module
from inspect import getdoc
from typing import Annotated, Any

import typer
from typer.core import TyperCommand
from typer.main import get_command

from core import __version__, process
from core.cli.help_page import Command, Group
from core.cli.status import STATUS_OF, Status
from core.cli.terminal import as_json, say, say_error, say_json, unhandled
from core.errors import ErrorCode, MeshmarkError

MARK, LAB, HERE = "Mark and verify", "Compare and measure", "This machine"


COMMANDS = {
    "apply": ("Watermark files.", MARK),
    "verify": ("Read marks and labels of a file back.", MARK),
    "evaluate": ("Measure a watermarked file against its original.", MARK),
    "explain": ("Show why marks stand where they stand.", MARK),
    "attack": ("Damage a watermarked file as a thief would.", LAB),
    "benchmark": ("Compare methods over a folder of assets.", LAB),
    "study": ("Ask people about two methods, and count their answers.", LAB),
    "profile": ("Where the seconds of our own method go, over a folder of assets.", LAB),
    "sizing": ("How many workers so many uploads take.", LAB),
    "models": ("Weights that make the semantics score the paper's.", HERE),
    "doctor": ("What this machine has of all that Meshmark needs.", HERE),
}


def load_command(name: str) -> Command:
    """The command of this name with its options, from the module of the same name.

    That module has a function of that name too; it may have an ``EPILOG`` for the end of the help page, and ``USAGE``,
    the arguments in words.
    """
    module = import_module(f"core.cli.{name}")
    function = getattr(module, name)
    text = re.sub(r"(?<!\n)\n(?!\n)", " ", getdoc(function) or "")  # as wide as the terminal
    app = typer.Typer(add_completion=False, rich_markup_mode="rich")
    app.command(name, cls=Command, help=text, epilog=getattr(module, "EPILOG", None))(function)
    command = get_command(app)
    assert isinstance(command, Command)
    command.usage = getattr(module, "USAGE", "")
    return command


class Summary(TyperCommand):
    """A command in the list of all, by its name and one line: it is loaded when it is called or completed."""

    def __init__(self, name: str, line: str, panel: str) -> None:
        super().__init__(name=name, help=line, rich_help_panel=panel)
        self._name = name

    def make_context(self, *arguments: Any, **more: Any) -> Any:
        """The context of the command itself, which is invoked then."""
        return load_command(self._name).make_context(*arguments, **more)


def _print_version(asked: bool) -> None:
    if asked:
        say(f"meshmark {__version__}")
        raise typer.Exit


application = typer.Typer(cls=Group, rich_markup_mode="rich")


@application.callback()
def _top(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Emboss visible watermarks into 3D assets."""


def group() -> Group:
    """``meshmark`` with all commands."""
    top = get_command(application)
    assert isinstance(top, Group)
    for name, (line, panel) in COMMANDS.items():
        top.add_command(Summary(name, line, panel))
    return top


def main(arguments: list[str] | None = None) -> int:
    """Runs one command; returns the exit status, a member of :class:`Status`."""
    process.before_command()
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        status = group().main(arguments or ["--help"], prog_name="meshmark", standalone_mode=False)
        if status == Status.INTERRUPTED:
            say("meshmark: interrupted", sys.stderr)
        return Status(status or Status.DONE) if arguments else Status.USAGE
    except typer.TyperException as error:
        return _failed(_wrong_usage(error), arguments)
    except MeshmarkError as error:
        return _failed(error, arguments)
    except Exception as error:  # not the user's: the trace is for the report that the remedy asks for
        say(traceback.format_exc(), sys.stderr)
        return _failed(unhandled(error), arguments)


def _failed(error: MeshmarkError, arguments: list[str]) -> Status:
    say_error(error)
    if "--json" in arguments:
        say_json({"error": as_json(error)})
    return STATUS_OF[error.code]


def _wrong_usage(error: typer.TyperException) -> MeshmarkError:
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "meshmark"
    message = error.format_message().replace("Value error, ", "").rstrip(".")
    return MeshmarkError(ErrorCode.INVALID_REQUEST, message + "." * (message[-1] not in "?)"), f"See `{path} --help`.")
