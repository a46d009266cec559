"""README and manual as tests look at them: pages, tables, command lines."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
MANUAL = ROOT / "service" / "docs"


def page(name: str) -> str:
    """The text of a page of the manual."""
    return (MANUAL / f"{name}.md").read_text()


def rows(name: str, heading: str) -> list[list[str]]:
    """The cells of the first table under a heading of a page, without its head."""
    below = re.split(rf"^#+ {re.escape(heading)}$", page(name), flags=re.MULTILINE)[1]
    section = re.split(r"^#+ ", below, flags=re.MULTILINE)[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[2:]]


def names(name: str, heading: str) -> list[str]:
    """What the first column of that table names, without its quotes."""
    return [row[0].strip("`") for row in rows(name, heading)]


def command_lines(text: str) -> str:
    """A text with its continued lines joined."""
    return text.replace("\\\n", " ")
