"""Files of the command line: errors are those of the engine."""

from pathlib import Path

from core.errors import ErrorCode, MeshmarkError


def read_file(path: Path) -> bytes:
    """The content of a file.

    Raises:
        MeshmarkError: ``missing_file``.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise MeshmarkError(
            ErrorCode.MISSING_FILE, f"{path} cannot be read: {error.strerror}.", "Check the path and its permissions."
        ) from None


def write_file(path: Path, data: bytes) -> None:
    """Write beside the target and rename, so that no half-written file is ever left under its name.

    Raises:
        MeshmarkError: ``output_not_writable``.
    """
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_bytes(data)
        partial.replace(path)
    except OSError as error:
        raise MeshmarkError(
            ErrorCode.OUTPUT_NOT_WRITABLE, f"{path} cannot be written: {error.strerror}.", "Choose another place."
        ) from None
