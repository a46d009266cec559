"""The list of texts of `meshmark apply --copies`: a CSV with a column `text`, and a line for each copy."""

import csv
import io
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from core.cli.files import read_file, write_file
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters, parse_parameters
from core.validation import first_repeat, shortened

MOST = 1000  # copies
TEXT, INDEX = "text", "copies.csv"  # the column of texts; the list of the results
RESULT = ("input", "output", "watermarks", "seconds", "error")  # columns that the list of the results adds
LONGEST_SLUG = 60  # characters of a text in a file's name


@dataclass(frozen=True)
class Line:
    """A line of the list: its text, and what else is said of it, by column."""

    text: str
    more: tuple[tuple[str, str], ...] = ()


def read_texts(path: Path, parameters: Parameters, logo: bool) -> list[Line]:
    """The lines of a list of texts, each of which can be a request's.

    Args:
        path: of a CSV in UTF-8 with a header.
        parameters: of every copy, but for its text.
        logo: whether there is one.

    Raises:
        MeshmarkError: ``missing_file``; ``invalid_request``, it is no such list, has more than 1,000 lines or none, or
            a text twice; ``empty_text`` or ``invalid_parameters``, naming the line.
    """
    try:
        rows = csv.reader(io.StringIO(read_file(path).decode("utf-8-sig"), newline=""), strict=True)
        header, *records = [row for row in rows if any(row)] or [[]]
    except (UnicodeDecodeError, csv.Error) as error:
        raise _invalid(path, f"cannot be read as CSV in UTF-8 ({error})") from None
    if TEXT not in header or len(set(header)) < len(header) or set(header) & set(RESULT):
        own = ", ".join(RESULT)
        raise _invalid(path, f"needs a header with a column `text`, none twice, and none of those of results ({own})")
    if not 1 <= len(records) <= MOST:
        raise _invalid(path, f"has {len(records):,} lines below its header; 1 to {MOST:,} are marked at once")
    lines = []
    for number, record in enumerate(records):
        if len(record) != len(header):
            raise _invalid(path, f"has {len(record)} columns for copy {number + 1}, and {len(header)} in its header")
        values = dict(zip(header, record, strict=True))
        text = values.pop(TEXT).replace(r"\n", "\n")
        try:
            parse_parameters(parameters.model_dump(mode="json") | {"text": text}).require_content(logo)
        except MeshmarkError as error:
            where = f"Copy {number + 1} of {path}, {shortened(text)!r}: "
            raise MeshmarkError(error.code, where + error.message, error.remedy) from None
        lines.append(Line(text, tuple(values.items())))
    if repeat := first_repeat([line.text for line in lines]):
        first, again = repeat
        raise _invalid(path, f"has the text {shortened(lines[again].text)!r} in the copies {first + 1} and {again + 1}")
    return lines


def names(stem: str, lines: list[Line]) -> list[str]:
    """File names, without their endings, of the copies of an asset: numbered, with their texts as far as files may have
    them."""
    digits = len(str(len(lines)))
    slugs = (re.sub(r"[^\w.-]+", "-", line.text).strip("-.")[:LONGEST_SLUG] for line in lines)
    return [f"{stem}-{number:0{digits}}" + f"-{slug}" * bool(slug) for number, slug in enumerate(slugs, start=1)]


def write_index(path: Path, rows: Iterable[tuple[Line, Mapping[str, object]]]) -> None:
    """Write the list of what became of each line: its own columns, and those of the result."""
    told = [{TEXT: line.text} | dict(line.more) | dict(result) for line, result in rows]
    content = io.StringIO(newline="")
    writer = csv.DictWriter(content, list(told[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(told)
    write_file(path, content.getvalue().encode())


def _invalid(path: Path, problem: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.INVALID_REQUEST,
        f"{path} {problem}.",
        "Give a CSV with a header, a column `text`, and a line for each copy, no text twice.",
    )
