"""One file to be marked: its names, the work, and the outcome in words."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from core.choices import Evaluate
from core.cli.files import STANDARD, read_file, write_file, write_json
from core.cli.progress import Progress, progress
from core.cli.status import STATUS_OF, Status
from core.cli.terminal import as_json, say, say_error, say_json
from core.cli.texts import Line
from core.errors import ErrorCode, MeshmarkError
from core.notices import NoticeCode
from core.parameters import Parameters

if TYPE_CHECKING:
    from core.formats.format import OutputFile
    from core.pipeline import Result

LOADING = "loading"  # the stage before the engine's own: its libraries


@dataclass(frozen=True)
class Order:
    """The names of one file's input and results."""

    input: Path
    output: Path
    report: Path | None = None
    preview: Path | None = None
    turntable: Path | None = None
    poster: Path | None = None
    preview_model: Path | None = None
    copies: tuple["CopyOrder", ...] = ()

    @property
    def pictures(self) -> dict[str, Path]:
        """Names of the pictures that are wanted, by those that the engine gives them."""
        names = {"preview": self.preview, "turntable": self.turntable, "poster": self.poster}
        return {name: path for name, path in names.items() if path is not None}

    @property
    def results(self) -> list[Path]:
        """All files that are to be written."""
        return [
            path
            for each in self.parts
            for path in (each.output, each.report, each.preview_model, *each.pictures.values())
            if path is not None
        ]

    @property
    def parts(self) -> "list[Order]":
        """The orders of its copies, or itself where it has none."""
        return [copy.order for copy in self.copies] or [self]


@dataclass(frozen=True)
class CopyOrder:
    """A copy for one buyer: its line in the list of texts, and the names of its results."""

    line: Line
    order: Order


@dataclass(frozen=True)
class Style:
    """Parameters, and the content of font and logo: the same for all files."""

    parameters: Parameters
    font: bytes | None
    logo: bytes | None


@dataclass(frozen=True)
class Telling:
    """Manner of telling the outcome: not at all, or for programs."""

    quiet: bool
    as_json: bool


@dataclass(frozen=True)
class Outcome:
    """Outcome of an order.

    Attributes:
        order: that was worked on.
        watermarks: number of marks.
        seconds: of the stages.
        warnings: of the report.
        error: that kept it from being done; None where it was done.
        trace: of an error that is not handled.
        export: the file in another format, where one was written.
        copies: the outcome of each copy, where the order has some; this one is theirs together.
    """

    order: Order
    watermarks: int = 0
    seconds: float = 0.0
    warnings: tuple[dict[str, str], ...] = ()
    error: MeshmarkError | None = None
    trace: str = ""
    export: Path | None = None
    copies: "tuple[Outcome, ...]" = ()

    def summary(self) -> str:
        """Marks and seconds in words, or copies and seconds."""
        if self.copies:
            done = sum(copy.error is None for copy in self.copies)
            return f"{done} of {len(self.copies)} copies in {self.seconds:.1f} s"
        return f"{self.watermarks} watermark{'s' * (self.watermarks != 1)} in {self.seconds:.1f} s"

    def as_json(self) -> dict[str, Any]:
        """The outcome for programs; names of files that were not written are null."""
        names = [field.name for field in fields(Order) if field.name != "copies"]
        written = {name: str(path) if (path := getattr(self.order, name)) else None for name in names}
        return {
            **(written if self.error is None else dict.fromkeys(written) | {"input": str(self.order.input)}),
            "export": str(self.export) if self.export else None,
            "outcome": "done" if self.error is None else "failed",
            "watermarks": self.watermarks,
            "seconds": round(self.seconds, 3),
            "warnings": list(self.warnings),
            "error": as_json(self.error) if self.error else None,
        }


def mark(order: Order, style: Style, tell: Progress | None) -> Outcome:
    """Mark one file and write its results.

    Raises:
        MeshmarkError: where it cannot be marked or a result cannot be written; the model is written before its
            pictures are missed.
    """
    data = read_file(order.input)
    if tell is not None:
        tell(LOADING, 0.0)
    if order.copies:
        return _mark_copies(data, order, style, tell)
    from core.pipeline import watermark  # torch and the geometry libraries take seconds: not for --help or a typo

    result = watermark(
        data,
        style.parameters,
        font=style.font,
        logo=style.logo,
        preview=order.preview is not None,
        progress=_of_stages_asked_for(tell, order, style.parameters) if tell else None,
    )
    return _written(order, result)


def _mark_copies(data: bytes, order: Order, style: Style, tell: Progress | None) -> Outcome:
    """Mark all copies of one file, each with its own text, and write the results of each as soon as they are made."""
    from core.series import watermark_series

    def told(number: int, stage: str, share: float) -> None:
        if tell is not None:
            tell(stage, (number + share) / len(order.copies))

    wanted = [style.parameters.model_copy(update={"text": copy.line.text}) for copy in order.copies]
    results = watermark_series(
        data,
        wanted,
        font=style.font,
        logo=style.logo,
        preview=order.preview is not None,
        progress=lambda number, *part: _of_stages_asked_for(partial(told, number), order, style.parameters)(*part),
    )
    outcomes = []
    for copy, result in zip(order.copies, results, strict=True):
        if isinstance(result, MeshmarkError):
            outcomes.append(Outcome(copy.order, error=result))
        else:
            outcomes.append(_written(copy.order, result))
    marks, seconds = (sum(getattr(each, name) for each in outcomes) for name in ("watermarks", "seconds"))
    return Outcome(order, marks, seconds, copies=tuple(outcomes))


def _written(order: Order, result: "Result") -> Outcome:
    """Write the results of one file.

    Raises:
        MeshmarkError: a picture is missing, or a file cannot be written.
    """
    warnings = result.report["warnings"]
    export = export_path(order, result.export) if result.export else None
    files = {order.output: result.file.data} | ({export: result.export.data} if result.export and export else {})
    for path, content in files.items():
        write_file(path, content)
    if order.report:
        write_json(order.report, result.report)
    if order.preview_model:
        if result.preview_model is None:
            warning = next(each for each in warnings if each["code"] == NoticeCode.NO_PREVIEW_MODEL)
            raise MeshmarkError(ErrorCode.NO_PLACEMENT, warning["message"], warning["remedy"])
        write_file(order.preview_model, result.preview_model)
    for name, path in order.pictures.items():
        picture: bytes | None = getattr(result, name)
        if picture is None:
            warning = warnings[-1]  # drawing is the last stage that warns
            raise MeshmarkError(ErrorCode(warning["code"]), warning["message"], warning["remedy"])
        write_file(path, picture)
    seconds = sum(result.report["timings"].values())
    return Outcome(order, len(result.report["watermarks"]), seconds, tuple(warnings), export=export)


def export_path(order: Order, export: "OutputFile") -> Path:
    """The place of the result in another format: beside a GLB; else it is what the output's name stands for.

    Raises:
        MeshmarkError: ``invalid_request`` where that is the input.
    """
    if order.output.suffix.lower() != ".glb":
        return order.output
    path = order.output.with_suffix(f".{export.format.rpartition('+')[2]}")
    if path.resolve() == order.input.resolve():
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            f"{path} would be written over, which is the input.",
            "Choose another name or another folder for the result.",
        )
    return path


def _of_stages_asked_for(tell: Progress, order: Order, parameters: Parameters) -> Callable[[str, float], None]:
    """``tell`` without the stages that have nothing to do, the share done being that of the others."""
    from core.pipeline import STAGES

    idle = set[str]()
    if parameters.evaluate is Evaluate.NONE:
        idle |= {"evaluating"}
    if parameters.evaluate is not Evaluate.FULL and not order.pictures:
        idle |= {"rendering"}
    total = sum(share for name, share in STAGES.items() if name not in idle)

    def of_those(stage: str, share: float) -> None:
        if stage not in idle:
            tell(stage, min(share / total, 1.0))

    return of_those


def mark_one(order: Order, style: Style, telling: Telling) -> Status:
    """Mark one file and tell the outcome."""
    outcome = Outcome(order)
    try:
        with progress("standard input" if order.input == STANDARD else str(order.input), quiet=telling.quiet) as tell:
            outcome = mark(order, style, tell)
    except MeshmarkError as error:
        outcome = Outcome(order, error=error)
        say_error(error)
    if telling.as_json:
        say_json({"files": [outcome.as_json()]})
    if outcome.error:
        return STATUS_OF[outcome.error.code]
    if not telling.quiet and not telling.as_json:
        for warning in outcome.warnings:
            say(f"warning: {warning['message']} {warning['remedy']}", sys.stderr, style="yellow")
        stream = sys.stderr if STANDARD in order.results else sys.stdout
        say(f"{order.output}: {outcome.summary()}", stream)
    return Status.DONE
