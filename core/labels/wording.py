"""Wording of a request: in the letters of its marks, and in a label for machines."""

from typing import Annotated, Any

from pydantic import ConfigDict, Field, field_validator
from pydantic_core import PydanticCustomError

from core.errors import ErrorCode, MeshmarkError
from core.labels.declaration import Declaration
from core.labels.profiles import PROFILES, Label, lacking
from core.validation import StrictModel

MAX_TEXT_LENGTH = 200
MAX_LINES = 6
COUNT = 24  # marks, at most, where a label has to be of a height in every view


class Wording(StrictModel):
    """Part of :class:`core.parameters.Parameters`."""

    model_config = ConfigDict(frozen=True)

    text: Annotated[
        str,
        Field(
            max_length=MAX_TEXT_LENGTH,
            description="The word or words to emboss; up to 6 lines. It may be empty where there is a logo or a label.",
        ),
    ] = ""
    label: Annotated[
        Label | None,
        Field(
            description="Write a machine-readable label into the result, by the rules of a place: China, the European "
            'Union, California, Korea, India; "custom": your own words. It brings the words of the mark where there is '
            'no `text`. null: "custom" with the preset "provenance" or a `declaration`, else no label.'
        ),
    ] = None
    declaration: Annotated[
        Declaration | None,
        Field(description="Statements about the model for its label, written as they are; nothing is made up."),
    ] = None
    metadata_only: Annotated[bool, Field(description="Write the label, and no mark.")] = False

    @field_validator("text")
    @classmethod
    def _few_lines(cls, value: str) -> str:
        lines = value.strip("\r\n").count("\n") + 1
        if lines > MAX_LINES:
            raise PydanticCustomError("lines", f"Text should have at most {MAX_LINES} lines, not {lines}")
        return value

    def chosen_label(self, preset: Label | None) -> Label | None:
        """The label that is asked for, or that a ``preset`` or a declaration stands for."""
        return self.label or preset or (None if self.declaration is None else Label.CUSTOM)

    @property
    def rule(self) -> float | None:
        """Share of the picture's shorter side that the label's letters should be high; None without such a rule."""
        return None if self.label is None else PROFILES[self.label].height

    @property
    def first_line(self) -> float:
        """Size of the first of several lines over that of the others."""
        return 1.0 if self.label is None else PROFILES[self.label].first_line

    def label_preset(self, preset: Label | None) -> dict[str, Any]:
        """Values of a label that stand in the place of the preset's: where its rule asks for a height, letters are as
        large as that, and there are as many marks as show them from all sides."""
        label = self.chosen_label(preset)
        return {} if label is None or PROFILES[label].height is None else {"size": None, "count": COUNT}

    def label_values(self, preset: Label | None) -> dict[str, Any]:
        """The label, and the text, or that label's words where there is none."""
        label = self.chosen_label(preset)
        return {"label": label, "text": self.text if self.text.strip() or label is None else PROFILES[label].words}

    def require_label(self) -> None:
        """Refuse a request for a label and nothing else without a label, or whose text is not what its label says.

        Raises:
            MeshmarkError: ``invalid_parameters``.
        """
        if self.metadata_only and self.label is None:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                "The request has `metadata_only`, but asks for no label that could be written.",
                "Send a `label`, or leave `metadata_only` out.",
            )
        if self.label is not None and self.text.strip() and (missing := lacking(self.label, self.text)):
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f'The `text` is not what the label "{self.label}" has to say: it lacks {" and ".join(missing)}.',
                'Leave `text` out for the usual words, add what is missing, or ask for the label "custom".',
            )
