"""Many files to be marked: which they are, what their results are called, and the table at the end."""

import glob
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from core.cli import texts
from core.cli.files import STANDARD, make_folder
from core.cli.order import CopyOrder, Order, Outcome, Style, Telling
from core.cli.pool import mark_all
from core.cli.status import Status
from core.cli.terminal import Column, say, say_error, say_json, say_table
from core.cli.texts import Line
from core.errors import ErrorCode, MeshmarkError

COLUMNS = (Column("file"), Column("marks", right=True), Column("seconds", right=True), Column("outcome"))


@dataclass(frozen=True)
class Folders:
    """Folders of the results: of models, and where they are wanted of reports, pictures and preview models."""

    models: Path
    reports: Path | None = None
    previews: Path | None = None
    turntables: Path | None = None
    posters: Path | None = None
    preview_models: Path | None = None


@dataclass(frozen=True)
class Found:
    """A file to be marked, and its name below the folder or glob that it was found by."""

    path: Path
    name: Path


def orders(paths: Iterable[Path], folders: Folders, lines: list[Line] | None = None) -> list[Order]:
    """The orders for all files that ``paths`` stand for, in their order, and below a folder in that of the names.

    Args:
        paths: files, folders (every file of an accepted format, at any depth) and globs. A file that is not there is
            ordered, and fails with the others' going on.
        folders: of the results. What lies in that of the models is no input.
        lines: of the copies of each file; None for one result of each.

    Raises:
        MeshmarkError: ``missing_file`` for a folder or glob without a file; ``invalid_request`` for standard input, and
            where a result would have the name of another or of an input.
    """
    found: dict[Path, Found] = {}
    for path in paths:
        for each in _found(path, folders.models.resolve()):
            found.setdefault(each.path.resolve(), each)
    names = _result_names([each.name for each in found.values()])
    made = [_order(each.path, folders, name) for each, name in zip(found.values(), names, strict=True)]
    if lines:
        made = [_of_copies(order, folders, name, lines) for order, name in zip(made, names, strict=True)]
    models = [each.output for order in made for each in order.parts]
    for path in models:
        if path.resolve() in found:
            raise MeshmarkError(
                ErrorCode.INVALID_REQUEST,
                f"{path} would be written over, which is an input.",
                "Choose another folder for the results.",
            )
    [(name, times)] = Counter(map(_folded, models)).most_common(1)
    if times > 1:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            f"The copies of two inputs would have the same name, {name}.",
            "Mark these inputs one by one, or into different folders.",
        )
    return made


def _order(path: Path, folders: Folders, name: Path) -> Order:
    return Order(
        path,
        folders.models / name,
        _beside(folders.reports, name, ".json"),
        _beside(folders.previews, name, ".png"),
        _beside(folders.turntables, name, ".webp"),
        _beside(folders.posters, name, ".poster.webp"),
        _beside(folders.preview_models, name, ".preview.glb"),
    )


def _of_copies(order: Order, folders: Folders, name: Path, lines: list[Line]) -> Order:
    """The order with one of its own for each copy."""
    own = [name.with_name(f"{stem}.glb") for stem in texts.names(name.stem, lines)]
    copies = [CopyOrder(line, _order(order.input, folders, each)) for line, each in zip(lines, own, strict=True)]
    return replace(order, copies=tuple(copies))


def _found(path: Path, results: Path) -> Iterator[Found]:
    if path == STANDARD:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "Standard input has no name that its result could have.",
            "Leave out `--out`, and name the result: `meshmark apply - out.glb`.",
        )
    if path.is_dir():
        from core.lab.benchmark.datasets import load

        inside = [Found(asset.path, Path(asset.name)) for asset in load(path, "folder", "").assets]
    elif glob.has_magic(str(path)) and not path.exists():
        base = Path(*(part for part in _before_magic(path)))
        matches = sorted(base.glob(str(path.relative_to(base))))
        inside = [Found(match, match.relative_to(base)) for match in matches if match.is_file()]
    else:
        yield Found(path, Path(path.name))
        return
    left = [each for each in inside if not each.path.resolve().is_relative_to(results)]
    if not left:
        raise MeshmarkError(
            ErrorCode.MISSING_FILE, f"{path} stands for no file.", "Check the path, or the pattern in quotes."
        )
    yield from left


def _before_magic(path: Path) -> Iterator[str]:
    """The parts of a glob up to the first with a wildcard."""
    for part in path.parts:
        if glob.has_magic(part):
            return
        yield part


def _result_names(names: list[Path]) -> list[Path]:
    """The names of models below their folder: those of the inputs with the ending .glb; of inputs that would share one,
    with their own ending before it.

    Raises:
        MeshmarkError: ``invalid_request`` where two inputs would share one nevertheless.
    """
    short = [name.with_suffix(".glb") for name in names]
    shared = Counter(map(_folded, short))
    long = [
        name.with_name(f"{name.name}.glb") if shared[_folded(brief)] > 1 else brief
        for name, brief in zip(names, short, strict=True)
    ]
    [(name, times)] = Counter(map(_folded, long)).most_common(1)
    if times > 1:
        inputs = " and ".join(str(given) for given, result in zip(names, long, strict=True) if _folded(result) == name)
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            f"The results of {inputs} would have the same name.",
            "Mark them one by one, or into different folders.",
        )
    return long


def _folded(name: Path) -> str:
    """A name as file systems compare it that do not mind case."""
    return name.as_posix().casefold()


def _beside(folder: Path | None, name: Path, ending: str) -> Path | None:
    return folder / name.with_suffix(ending) if folder else None


def mark_many(wanted: list[Order], style: Style, jobs: int, telling: Telling, index: Path | None = None) -> Status:
    """Mark files, ``jobs`` at once, and tell the outcome of each in their order.

    Args:
        wanted: the orders.
        style: of all of them.
        jobs: number of processes.
        telling: the manner of telling.
        index: of copies, to be written: which text is in which file; None where there are no copies.

    Raises:
        MeshmarkError: ``output_not_writable`` where a folder for the results cannot be made.
    """
    for order in wanted:
        for path in order.results:
            make_folder(path.parent)
    outcomes = mark_all(wanted, style, jobs, quiet=telling.quiet)
    results = [each for outcome in outcomes for each in outcome.copies or (outcome,)]
    failed = [result for result in results if result.error]
    for result in failed:
        if result.trace:
            say(result.trace, sys.stderr)
        assert result.error is not None
        say_error(result.error, about=str(result.order.input))
    if telling.as_json:
        say_json({"files": [result.as_json() for result in results]})
    elif not telling.quiet:
        say_table(COLUMNS, [_row(result) for result in results], ["red" if o.error else "green" for o in results])
        told = f", {len(failed)} failed" if failed else ""
        say(f"{len(results) - len(failed)} of {len(results)} files marked{told}", style="red" if failed else "green")
    if index is not None:
        texts.write_index(index, [row for outcome in outcomes for row in _indexed(outcome)])
    return Status.SOME_FAILED if failed else Status.DONE


def _indexed(outcome: Outcome) -> Iterator[tuple[Line, dict[str, object]]]:
    """The lines of the index about one file: what became of each copy, or why there is none."""
    for number, copy in enumerate(outcome.order.copies):
        one = outcome.copies[number] if outcome.copies else outcome
        yield (
            copy.line,
            {
                "input": outcome.order.input,
                "output": "" if one.error else copy.order.output,
                "watermarks": one.watermarks,
                "seconds": round(one.seconds, 3),
                "error": one.error.code if one.error else "",
            },
        )


def _row(outcome: Outcome) -> tuple[str, str, str, str]:
    name = str(outcome.order.input)
    if outcome.error is not None:
        return name, "", "", f"failed: {outcome.error.code}"
    return name, str(outcome.watermarks), f"{outcome.seconds:.1f}", str(outcome.order.output)
