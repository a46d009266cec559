"""Notices of deviations from a request where nothing failed: a stable code, a sentence about this input, a remedy."""

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar


class NoticeCode(StrEnum):
    """The codes of notices that are no failure anywhere; a code is never renamed or reused once released."""

    # Warnings of a report.
    UNREFERENCED_DATA = "unreferenced_data"
    UNMARKED_COPIES = "unmarked_copies"
    UNMARKED_PARTS = "unmarked_parts"
    SEE_THROUGH_SURFACE = "see_through_surface"
    SMALL_TEXT = "small_text"
    LOW_CONTRAST = "low_contrast"
    HARD_TO_READ = "hard_to_read"
    UNREADABLE_QR = "unreadable_qr"
    FLAT_LETTERS = "flat_letters"
    FONT_SUBSTITUTED = "font_substituted"
    INCOMPLETE_LABEL = "incomplete_label"
    KEPT_LABEL = "kept_label"
    LABEL_TOO_SMALL = "label_too_small"
    PREVIEW_MODEL_HEAVY = "preview_model_heavy"
    PREVIEW_MODEL_LACKS = "preview_model_lacks"
    NO_PREVIEW_MODEL = "no_preview_model"
    LEFT_OUT_OF_EXPORT = "left_out_of_export"
    # Why a report has no value of a metric.
    NOT_REQUESTED = "not_requested"
    NOT_MEASURED = "not_measured"
    NO_TEXT = "no_text"
    UNREADABLE_SCRIPT = "unreadable_script"


@dataclass(frozen=True)
class Notice:
    """A warning, or the reason why a metric is missing."""

    # The JSON Schema of the report takes its descriptions from here, and allows for fields that are added later. This
    # module itself needs nothing but Python.
    __pydantic_config__: ClassVar = {"use_attribute_docstrings": True, "extra": "ignore"}

    code: NoticeCode | str
    """A stable code to program against: of a notice, or of the error that this is elsewhere."""
    message: str
    """What is so with this file or this request."""
    remedy: str
    """What to do about it."""
