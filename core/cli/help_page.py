"""Help pages: the way that typer draws them, with names of arguments alone and no type beside a flag."""

from typing import Any

from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

OUTPUT = "Output"  # the panel of options that say what is printed


class Command(TyperCommand):
    """A command.

    Attributes:
        usage: its arguments on the line of usage; if empty, their names.
    """

    usage = ""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Words after the command's name on the line of usage."""
        names = [each.display_name_raw for each in self.params if isinstance(each, TyperArgument)]
        return [super().collect_usage_pieces(ctx)[0], *([self.usage] if self.usage else names)]

    def get_params(self, ctx: Any) -> Any:
        """Arguments and options, ``--help`` with those that say what is printed."""
        found = without_types(super().get_params(ctx))
        found[-1].rich_help_panel = OUTPUT
        return found

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Draw the page, its columns near each other: there is room for more words on narrow terminals."""
        from typer import rich_utils  # with rich, which nothing else needs

        vars(rich_utils)["STYLE_OPTIONS_TABLE_PADDING"] = (0, 1, 0, 0)  # of four sides, as rich has it
        super().format_help(ctx, formatter)


class Group(TyperGroup):
    """The group of all commands."""

    def get_params(self, ctx: Any) -> Any:
        """The options of the group itself."""
        return without_types(super().get_params(ctx))


def without_types(parameters: Any) -> Any:
    """The same parameters, of which flags are shown without a type."""
    for each in parameters:
        if isinstance(each, TyperOption) and each.is_flag:
            each.metavar = ""
    return parameters
