"""Errors: a stable code, a sentence about this input, and a remedy.

Nothing else reaches a user: the service and the command line print exactly these three fields.
"""

from enum import StrEnum

from core.notices import Notice


class Code(StrEnum):
    """Stable codes; a code is never renamed or reused once released.

    Of no members: each package that raises errors has an enumeration of its own of this type.
    """


class ErrorCode(Code):
    """Codes that the engine raises."""

    # The uploaded file.
    EMPTY_FILE = "empty_file"
    UNKNOWN_FORMAT = "unknown_format"
    UNSUPPORTED_FORMAT = "unsupported_format"
    UNSUPPORTED_FEATURE = "unsupported_feature"
    MALFORMED_FILE = "malformed_file"
    TRUNCATED_FILE = "truncated_file"
    NO_FACES = "no_faces"
    NON_FINITE_POSITIONS = "non_finite_positions"
    INDEX_OUT_OF_RANGE = "index_out_of_range"
    BUDGET_EXCEEDED = "budget_exceeded"
    EXTERNAL_REFERENCE = "external_reference"
    TEXTURE_NOT_DECODED = "texture_not_decoded"  # a warning
    # What was asked for.
    INVALID_PARAMETERS = "invalid_parameters"
    EMPTY_TEXT = "empty_text"
    TEXT_TOO_LONG = "text_too_long"
    MISSING_GLYPHS = "missing_glyphs"
    INVALID_FONT = "invalid_font"
    INVALID_LOGO = "invalid_logo"
    UNKNOWN_REGION = "unknown_region"
    DIFFERENT_MODEL = "different_model"
    # The work itself.
    NO_PLACEMENT = "no_placement"
    NOT_MANIFOLD = "not_manifold"
    RENDERING_UNAVAILABLE = "rendering_unavailable"
    EVALUATION_FAILED = "evaluation_failed"
    OUTPUT_NOT_WRITABLE = "output_not_writable"
    MODEL_UNAVAILABLE = "model_unavailable"
    DEVICE_UNAVAILABLE = "device_unavailable"
    INTERNAL_ERROR = "internal_error"
    # The call, of the command line, a measurement or the benchmark; the service has the same cases.
    MISSING_FILE = "missing_file"
    INVALID_REQUEST = "invalid_request"
    TIME_LIMIT = "time_limit"
    ENGINE_CRASHED = "engine_crashed"


class MeshmarkError(Exception):
    """A failure a user can read.

    Args:
        code: the stable code.
        message: one sentence that says what is wrong with this file or this request.
        remedy: one sentence that says what to do about it.
    """

    def __init__(self, code: Code, message: str, remedy: str) -> None:
        super().__init__(code, message, remedy)  # all three in args, so that pickling keeps them
        self.code = code
        self.message = message
        self.remedy = remedy

    def notice(self) -> Notice:
        """The notice of the same text, where nothing fails: a warning, or the reason for a missing metric."""
        return Notice(self.code, self.message, self.remedy)

    def __str__(self) -> str:
        return f"{self.code}: {self.message} {self.remedy}"
