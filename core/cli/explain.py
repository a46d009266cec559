"""The command `meshmark explain`."""

from pathlib import Path
from typing import Annotated

import typer

from core.cli.files import read_file, require_streams
from core.cli.options import ACCEPTED, Json, Quiet
from core.cli.progress import progress
from core.cli.status import STATUS_OF, Status
from core.cli.terminal import say, say_error, say_json
from core.parameters import parse_parameters


def explain(
    source: Annotated[Path, typer.Argument(metavar="IN", help=f"{ACCEPTED}.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Write page, pictures, model and JSON there.")
    ],
    text: Annotated[str | None, typer.Option(metavar="T", help="What to emboss; default: what P.json says.")] = None,
    params: Annotated[
        Path | None, typer.Option(metavar="P.json", help="Parameters, as a request to the service has them.")
    ] = None,
    font: Annotated[Path | None, typer.Option(metavar="FILE", help="A TrueType or OpenType font.")] = None,
    logo: Annotated[Path | None, typer.Option(metavar="FILE", help="An SVG, alone or beside the text.")] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> Status:
    """Show why marks stand where they stand.

    Marks a file as `meshmark apply` does, and writes a page with every step: the candidates, before and after
    fine-tuning, what each filter dropped, what each mark adds and costs, and the marks that were refused. Also where no
    mark finds a place.
    """
    require_streams([source, params, font, logo], [])
    parameters = parse_parameters(read_file(params) if params else {})
    if text is not None:
        parameters = parse_parameters(parameters.model_dump(exclude_unset=True) | {"text": text.replace(r"\n", "\n")})
    parameters.require_content(logo is not None)
    with progress(str(source), quiet=quiet) as tell:
        from core.explain.explain import explain as trace
        from core.explain.page import write_explanation

        style = read_file(font) if font else None, read_file(logo) if logo else None
        found = trace(read_file(source), parameters, *style, progress=tell or (lambda _stage, _share: None))
        if tell is not None:
            tell("drawing", None)
        written = write_explanation(found, source.name, out)
    if json:
        say_json(found.facts)
    elif not quiet:
        say(f"{written[0]}: {len(found.marks)} marks among {found.facts['stages'][-1]['left']:,} places")
    if found.error is not None:
        say_error(found.error)
        return STATUS_OF[found.error.code]
    return Status.DONE
