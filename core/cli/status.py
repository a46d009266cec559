"""Exit statuses: zero where all was done, else one for each kind of error, of the numbers that sysexits.h gave them."""

from enum import IntEnum

from core.errors import Code, ErrorCode


class Status(IntEnum):
    """Exit statuses of ``meshmark``."""

    DONE = 0
    SOME_FAILED = 1
    USAGE = 2
    BAD_INPUT = 65  # EX_DATAERR
    NO_INPUT = 66  # EX_NOINPUT
    UNAVAILABLE = 69  # EX_UNAVAILABLE
    INTERNAL = 70  # EX_SOFTWARE
    NOT_WRITTEN = 73  # EX_CANTCREAT
    TEMPORARY = 75  # EX_TEMPFAIL
    INTERRUPTED = 130  # as shells say that SIGINT ended a command


MEANINGS = {
    Status.DONE: "done",
    Status.SOME_FAILED: "of several files, some failed; or the reader of the output has gone",
    Status.USAGE: "the command line is wrong",
    Status.BAD_INPUT: "a file is damaged, of no use here, or cannot carry the mark",
    Status.NO_INPUT: "a file cannot be read",
    Status.UNAVAILABLE: "this machine lacks something: OpenGL, a model, a device",
    Status.INTERNAL: "an error of the engine",
    Status.NOT_WRITTEN: "a result cannot be written",
    Status.TEMPORARY: "a limit of time; it may succeed another time",
    Status.INTERRUPTED: "interrupted",
}

# What an error of each code ends a command with.
STATUS_OF: dict[Code, Status] = {
    **dict.fromkeys(
        (
            *(ErrorCode.INVALID_PARAMETERS, ErrorCode.EMPTY_TEXT, ErrorCode.MISSING_GLYPHS, ErrorCode.UNKNOWN_REGION),
            *(ErrorCode.INVALID_REQUEST, ErrorCode.TEXT_TOO_LONG),
        ),
        Status.USAGE,
    ),
    **dict.fromkeys(
        (
            *(ErrorCode.EMPTY_FILE, ErrorCode.UNKNOWN_FORMAT, ErrorCode.UNSUPPORTED_FORMAT),
            *(ErrorCode.UNSUPPORTED_FEATURE, ErrorCode.MALFORMED_FILE, ErrorCode.TRUNCATED_FILE, ErrorCode.NO_FACES),
            *(ErrorCode.NON_FINITE_POSITIONS, ErrorCode.INDEX_OUT_OF_RANGE, ErrorCode.BUDGET_EXCEEDED),
            *(ErrorCode.EXTERNAL_REFERENCE, ErrorCode.TEXTURE_NOT_DECODED, ErrorCode.INVALID_FONT),
            *(ErrorCode.INVALID_LOGO, ErrorCode.DIFFERENT_MODEL, ErrorCode.NO_PLACEMENT, ErrorCode.NOT_MANIFOLD),
        ),
        Status.BAD_INPUT,
    ),
    ErrorCode.MISSING_FILE: Status.NO_INPUT,
    **dict.fromkeys(
        (ErrorCode.RENDERING_UNAVAILABLE, ErrorCode.MODEL_UNAVAILABLE, ErrorCode.DEVICE_UNAVAILABLE),
        Status.UNAVAILABLE,
    ),
    **dict.fromkeys((ErrorCode.EVALUATION_FAILED, ErrorCode.ENGINE_CRASHED, ErrorCode.INTERNAL_ERROR), Status.INTERNAL),
    ErrorCode.OUTPUT_NOT_WRITABLE: Status.NOT_WRITTEN,
    ErrorCode.TIME_LIMIT: Status.TEMPORARY,
}
