"""Files of the command line, standard input and output among them: errors are those of the engine."""

import json
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from core.errors import ErrorCode, MeshmarkError

STANDARD = Path("-")  # standard input, or standard output


def read_file(path: Path) -> bytes:
    """The content of a file, or of standard input for ``-``.

    Raises:
        MeshmarkError: ``missing_file``.
    """
    try:
        return sys.stdin.buffer.read() if path == STANDARD else path.read_bytes()
    except OSError as error:
        raise MeshmarkError(
            ErrorCode.MISSING_FILE, f"{path} cannot be read: {error.strerror}.", "Check the path and its permissions."
        ) from None


def write_file(path: Path, data: bytes) -> None:
    """Write to standard output for ``-``; else beside the target, and rename, so that no half-written file is ever left
    under its name.

    Raises:
        MeshmarkError: ``output_not_writable``.
    """
    partial = path.with_name(path.name + ".partial")
    try:
        if path == STANDARD:
            sys.stdout.buffer.write(data)
            sys.stdout.buffer.flush()
        else:
            partial.write_bytes(data)
            partial.replace(path)
    except BrokenPipeError:
        raise
    except OSError as error:
        with suppress(OSError):
            partial.unlink()
        raise MeshmarkError(
            ErrorCode.OUTPUT_NOT_WRITABLE, f"{path} cannot be written: {error.strerror}.", "Choose another place."
        ) from None


def make_folder(path: Path) -> None:
    """Make a folder and those above it, where they are not there.

    Raises:
        MeshmarkError: ``output_not_writable``.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MeshmarkError(
            ErrorCode.OUTPUT_NOT_WRITABLE, f"{path} cannot be made: {error.strerror}.", "Choose another place."
        ) from None


def write_json(path: Path, content: Any) -> None:
    """Write indented JSON, as :func:`write_file`."""
    text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
    write_file(path, text.encode(errors="backslashreplace"))  # halves of surrogate pairs as the escapes that they were


def require_streams(inputs: list[Path | None], outputs: list[Path | None], *, as_json: bool = False) -> None:
    """Check that standard input and output are each used once at most.

    Args:
        inputs: files to be read.
        outputs: files to be written.
        as_json: the outcome is printed on standard output as well.

    Raises:
        MeshmarkError: ``invalid_request``.
    """
    if inputs.count(STANDARD) > 1:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST, "Standard input is to be read twice.", "Write `-` for one input at most."
        )
    if outputs.count(STANDARD) > 1 - as_json:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "Standard output is to be written twice.",
            "Write `-` for one output at most, and for none beside `--json`.",
        )
    if STANDARD in outputs and sys.stdout.isatty():
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST,
            "Standard output is a terminal, which shows no such file.",
            "Send it to a file or to another program: `meshmark ... - > out.glb`.",
        )
