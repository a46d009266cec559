"""The command `meshmark verify`."""

import argparse
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from core.cli_files import read_file, write_file
from core.errors import ErrorCode, MeshmarkError

if TYPE_CHECKING:
    from core.verify.original import Against
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
    verify.add_argument(
        "--original", type=Path, metavar="ORIGINAL", help="the asset without marks, to compare its shape with"
    )
    verify.add_argument(
        "--report-of",
        type=Path,
        metavar="R.json",
        help="the report of the job that marked ORIGINAL: are these its marks?",
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
    result = verify(read_file(options.input), options.text, against=_against(options), seal=_seal(options))
    report = result.report
    if options.report:
        write_file(options.report, (json.dumps(report, indent=2, ensure_ascii=False) + "\n").encode())
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
        for kind, pictures in (("mark", result.pictures), ("height", result.heights)):
            for number, picture in enumerate(pictures):
                write_file(options.pictures / f"{kind}-{number}.png", picture)
    if options.evidence:
        write_file(options.evidence, evidence_page(report, result.pictures, options.input.name, moment, result.heights))
    for line in _lines(options.input, report):
        print(line)


def _seal(options: argparse.Namespace) -> "Seal":
    from core.verify.seal import Seal

    sidecar = read_file(options.credentials) if options.credentials else None
    return Seal(sidecar, read_file(options.trust).decode(errors="replace") if options.trust else None)


def _against(options: argparse.Namespace) -> "Against | None":
    from core.verify.original import Against

    if options.original is None and options.report_of is not None:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            "`--report-of` names the report of a job without the file that the job marked.",
            "Give that file with `--original`.",
        )
    if options.original is None:
        return None
    return Against(read_file(options.original), read_file(options.report_of) if options.report_of else None)


def _lines(path: Path, report: dict[str, Any]) -> list[str]:
    """The result in words."""
    marks, label = report["marks"], report["label"]
    lines = [f"{path}: {len(marks)} marks read"]
    for mark in marks:
        said = f'"{mark["text"]}"' + (f' ("{mark["known"]}")' if mark["known"] not in (None, mark["text"]) else "")
        where = ", ".join(f"{value:.3g}" for value in mark["center"] or mark["pixel"])
        lines.append(f"  {said} at {where}, in {mark['votes']} pictures, confidence {mark['confidence']:.2f}")
    lines += [f'not found: "{text}"' for text in report["texts"] if text not in report["found"]]
    if report["original"] is not None:
        lines += _compared(report["original"])
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


def _compared(original: dict[str, Any]) -> list[str]:
    """The comparison with an original in words."""
    marks = original["marks"]
    lines = [
        f"original: residual {100 * original['residual']:.2g} %, covered {100 * original['covered']:.0f} %, "
        f"scale {original['scale']:.6g}"
    ]
    if original["is_asset"] is None:
        return lines
    known = [mark for mark in marks if mark["present"] is not None]
    there = sum(mark["present"] for mark in known)
    lines.append(f"marks of the job: {there} of {len(marks)} there, {len(marks) - len(known)} where nothing is left")
    if not original["is_asset"]:
        lines.append("the report is about another file than this original")
    return lines + (["the very result of the job, byte for byte"] if original["is_result"] else [])
