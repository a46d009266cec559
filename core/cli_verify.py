"""The command `meshmark verify`."""

import argparse
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from core.cli_files import read_file, write_file

if TYPE_CHECKING:
    from core.verify.seal import Seal


def add_verify(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    verify = commands.add_parser(
        "verify",
        help="read marks and labels of a file back",
        description="Read the marks on a suspect file, whoever made it, and what its metadata say.",
    )
    verify.set_defaults(run=_verify)
    verify.add_argument("input", type=Path, metavar="FILE", help="the suspect file, or a picture of it")
    verify.add_argument(
        "--text", action="append", default=[], help="a text that its marks may say; may be repeated (default: any)"
    )
    verify.add_argument(
        "--credentials", type=Path, metavar="C.c2pa", help="the Content Credentials that came beside the file"
    )
    verify.add_argument(
        "--trust", type=Path, metavar="ROOTS.pem", help="root certificates that are trusted to sign credentials"
    )
    verify.add_argument("--report", type=Path, metavar="V.json", help="write the report here")
    verify.add_argument("--pictures", type=Path, metavar="DIR", help="write a picture of each mark there")
    verify.add_argument(
        "--evidence", type=Path, metavar="E.html", help="write a page for people here: marks, pictures, hashes, times"
    )


def _verify(options: argparse.Namespace) -> None:
    from core.verify.evidence import evidence_page
    from core.verify.verify import verify  # the renderer and the recogniser take a second to load

    moment = datetime.now(UTC)
    result = verify(read_file(options.input), options.text, seal=_seal(options))
    report = result.report
    if options.report:
        write_file(options.report, (json.dumps(report, indent=2, ensure_ascii=False) + "\n").encode())
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
        for number, picture in enumerate(result.pictures):
            write_file(options.pictures / f"mark-{number}.png", picture)
    if options.evidence:
        write_file(options.evidence, evidence_page(report, result.pictures, options.input.name, moment))
    for line in _lines(options.input, report):
        print(line)


def _seal(options: argparse.Namespace) -> "Seal":
    from core.verify.seal import Seal

    sidecar = read_file(options.credentials) if options.credentials else None
    return Seal(sidecar, read_file(options.trust).decode(errors="replace") if options.trust else None)


def _lines(path: Path, report: dict[str, Any]) -> list[str]:
    """The result in words."""
    marks, label = report["marks"], report["label"]
    lines = [f"{path}: {len(marks)} marks read"]
    for mark in marks:
        said = f'"{mark["text"]}"' + (f' ("{mark["known"]}")' if mark["known"] not in (None, mark["text"]) else "")
        where = ", ".join(f"{value:.3g}" for value in mark["center"] or mark["pixel"])
        lines.append(f"  {said} at {where}, in {mark['votes']} pictures, confidence {mark['confidence']:.2f}")
    lines += [f'not found: "{text}"' for text in report["texts"] if text not in report["found"]]
    stated = {name: value for name, value in (label or {}).items() if value}
    lines.append("metadata: " + (json.dumps(stated, ensure_ascii=False) if stated else "nothing"))
    lines.append(f"credentials: {_judged(report['credentials'])}")
    return lines + [f"warning: {notice['message']}" for notice in report["warnings"]]


def _judged(credentials: dict[str, Any] | None) -> str:
    """The credentials in words."""
    if credentials is None:
        return "not looked for; install meshmark[c2pa]"
    signed = ", ".join(filter(None, [credentials["issuer"], credentials["name"]]))
    codes = f" ({', '.join(credentials['codes'])})" if credentials["codes"] else ""
    return str(credentials["state"]) + (f", signed by {signed}" if signed else "") + codes
