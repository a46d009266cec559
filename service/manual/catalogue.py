"""A page for each error: the address that its problems name as their type."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from service.errors import CODES, title, type_of

ROW = re.compile(r"^\| `(\w+)` \| (\d{3}) \| (.+) \| (.+) \|$", re.MULTILINE)
LINK = re.compile(r"\]\((?=[\w-]+\.md)")
METHODS = ("get", "head", "post", "put", "patch", "delete")


def with_links(errors: str) -> str:
    """The manual's page of errors, each code with a link to its page."""
    return ROW.sub(lambda row: row[0].replace(f"`{row[1]}`", f"[`{row[1]}`](errors/{row[1]}.md)", 1), errors)


def error_pages(errors: str, openapi: Path) -> dict[str, str]:
    """The page of each code in Markdown, by the code.

    Args:
        errors: the manual's page of errors, whose tables have a row for each code.
        openapi: the OpenAPI document, which knows what operations answer with a code.

    Raises:
        ValueError: a code of the engine or the service has no row, or a row no code.
    """
    rows = {code: (int(status), meaning, remedy) for code, status, meaning, remedy in ROW.findall(errors)}
    if rows.keys() != CODES.keys():
        raise ValueError(f"The page of errors and the code differ in: {sorted(rows.keys() ^ CODES.keys())}.")
    operations = _operations(yaml.safe_load(openapi.read_text()))
    return {code: _page(code, *row, operations.get(code, [])) for code, row in rows.items()}


def _operations(document: dict[str, Any]) -> dict[str, list[str]]:
    """The operations, as `POST /v1/uploads`, that answer with each code."""
    found: dict[str, list[str]] = {}
    for path, item in document["paths"].items():
        for method in METHODS:
            for code in _codes(item.get(method, {})):
                found.setdefault(code, []).append(f"{method.upper()} {path}")
    return found


def _codes(operation: dict[str, Any]) -> Iterator[str]:
    for answer in operation.get("responses", {}).values():
        if "application/problem+json" in answer.get("content", {}):
            yield from re.findall(r"`(\w+)`", answer["description"])


def _page(code: str, status: int, meaning: str, remedy: str, operations: list[str]) -> str:
    """Markdown of one page."""
    named = {"type": type_of(CODES[code]), "title": title(CODES[code]), "status": status, "code": code}
    listed = "\n".join(f"- `{operation}`" for operation in operations)
    answered = f"\n## Answers of\n\n{listed}\n" if listed else ""
    return (
        f"# {title(CODES[code])}\n\n"
        f"`{code}` · status {status} · [all errors](../errors.md)\n\n"
        f"**Meaning.** {_sentence(meaning)}\n\n"
        f"**Remedy.** {_sentence(remedy)} The `remedy` of an answer is about its very file or request, and goes first."
        f"\n\n```json\n{json.dumps(named, indent=2)}\n```\n{answered}"
    )


def _sentence(cell: str) -> str:
    """A cell of a table as a sentence, with its links as they go from a folder below."""
    moved = LINK.sub("](../", cell)
    return f"{moved[0].upper()}{moved[1:]}."
