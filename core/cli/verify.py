"""The command `meshmark verify`."""

import json as json_text
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from core.cli.files import STANDARD, make_folder, read_file, require_streams, write_file, write_json
from core.cli.options import Json, Quiet
from core.cli.progress import progress
from core.cli.terminal import say, say_json
from core.errors import ErrorCode, MeshmarkError

if TYPE_CHECKING:
    from core.verify.original import Against
    from core.verify.seal import Seal

COMPARE, RESULTS = "Compare with", "Results"


def verify(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="The suspect file, or a picture of it; - for standard input."),
    ],
    text: Annotated[
        list[str] | None,
        typer.Option(
            metavar="T", help="A text that its marks may say; may be repeated; default: any.", show_default=False
        ),
    ] = None,
    original: Annotated[
        Path | None,
        typer.Option(
            metavar="ORIGINAL", help="The asset without marks, to compare its shape with.", rich_help_panel=COMPARE
        ),
    ] = None,
    report_of: Annotated[
        Path | None,
        typer.Option(
            metavar="R.json",
            help="The report of the job that marked ORIGINAL: are these its marks?",
            rich_help_panel=COMPARE,
        ),
    ] = None,
    credentials: Annotated[
        Path | None,
        typer.Option(
            metavar="C.c2pa", help="The Content Credentials that came beside the file.", rich_help_panel=COMPARE
        ),
    ] = None,
    trust: Annotated[
        Path | None,
        typer.Option(
            metavar="ROOTS.pem", help="Root certificates that are trusted to sign credentials.", rich_help_panel=COMPARE
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="V.json", help="Write the report here.", rich_help_panel=RESULTS)
    ] = None,
    pictures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a picture of each mark there.", rich_help_panel=RESULTS)
    ] = None,
    evidence: Annotated[
        Path | None,
        typer.Option(
            metavar="E.html", help="Write a page for people: marks, pictures, hashes, times.", rich_help_panel=RESULTS
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Read the marks on a suspect file, whoever made it, and what its metadata say."""
    require_streams([file, original, report_of, credentials, trust], [report, evidence], as_json=json)
    moment = datetime.now(UTC)
    data = read_file(file)
    with progress(str(file), quiet=quiet) as tell:
        if tell is not None:
            tell("reading marks", None)
        from core.verify.evidence import evidence_page
        from core.verify.verify import verify as read_back  # the renderer and the recogniser take a second to load

        against, seal = _against(original, report_of), _seal(credentials, trust)
        result = read_back(data, text or [], against=against, seal=seal)
    if report:
        write_json(report, result.report)
    if pictures:
        _write_pictures(pictures, {"mark": result.pictures, "height": result.heights})
    if evidence:
        write_file(evidence, evidence_page(result.report, result.pictures, file.name, moment, result.heights))
    if json:
        say_json(result.report)
    elif not quiet:
        stream = sys.stderr if STANDARD in (report, evidence) else sys.stdout
        for line in _lines(file, result.report):
            say(line, stream)


def _write_pictures(folder: Path, pictures: dict[str, tuple[bytes, ...]]) -> None:
    make_folder(folder)
    for kind, of_kind in pictures.items():
        for number, picture in enumerate(of_kind):
            write_file(folder / f"{kind}-{number}.png", picture)


def _seal(credentials: Path | None, trust: Path | None) -> "Seal":
    from core.verify.seal import Seal

    sidecar = read_file(credentials) if credentials else None
    return Seal(sidecar, read_file(trust).decode(errors="replace") if trust else None)


def _against(original: Path | None, report_of: Path | None) -> "Against | None":
    from core.verify.original import Against

    if original is None and report_of is not None:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            "`--report-of` names the report of a job without the file that the job marked.",
            "Give that file with `--original`.",
        )
    if original is None:
        return None
    return Against(read_file(original), read_file(report_of) if report_of else None)


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
    lines.append("metadata: " + (json_text.dumps(stated, ensure_ascii=False) if stated else "nothing"))
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
