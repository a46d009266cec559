"""What a caller may ask for. Lengths are in the size-30 frame (see ``core``)."""

import re
from enum import StrEnum
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator
from pydantic_core import PydanticCustomError

from core.errors import ErrorCode, MeshmarkError

MAX_TEXT_LENGTH = 64
# Of the text's width: 0.22 at 5.5. Higher reads better from the side, but narrow text turns into a row of spikes.
RELIEF = 0.04


class Preset(StrEnum):
    """Starting values for size, relief and count; anything given explicitly wins."""

    MERCHANDISE = "merchandise"
    PROVENANCE = "provenance"
    PAPER = "paper"


class Mode(StrEnum):
    """Raised letters or sunken ones."""

    EMBOSS = "emboss"
    DEBOSS = "deboss"


class Evaluate(StrEnum):
    """Which metrics the report carries."""

    FULL = "full"
    GEOMETRY = "geometry"
    NONE = "none"


class Solver(StrEnum):
    """How candidate boxes are fitted to the surface."""

    LEVENBERG_MARQUARDT = "levenberg-marquardt"
    ADAM = "adam"


# Text width, relief, number of watermarks, solver. "paper" repeats the supplement's implementation details (extrude
# strength 0.05, about ten watermarks, Adam). In the other two the relief grows with the text: see `relief_at`.
PRESETS: dict[Preset, dict[str, Any]] = {
    Preset.MERCHANDISE: {"size": None, "count": 16, "solver": Solver.LEVENBERG_MARQUARDT},
    Preset.PROVENANCE: {"size": 3.0, "count": 4, "solver": Solver.LEVENBERG_MARQUARDT},
    Preset.PAPER: {"size": 5.5, "relief": 0.05, "count": 10, "solver": Solver.ADAM},
}


class Parameters(BaseModel):
    """One watermarking request. ``None`` means "what the preset says"; :meth:`resolved` fills it in."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    text: Annotated[str, Field(max_length=MAX_TEXT_LENGTH, description="The word or words to emboss.")]
    preset: Annotated[Preset, Field(description="Starting values for size, relief, count and solver.")] = (
        Preset.MERCHANDISE
    )
    mode: Annotated[Mode, Field(description="Raised (emboss) or sunken (deboss) letters.")] = Mode.EMBOSS
    size: Annotated[
        float | None,
        Field(
            ge=0.5, le=30.0, description="Text width where the asset's largest side is 30; null: the widest that fits."
        ),
    ] = None
    relief: Annotated[
        float | None,
        Field(ge=0.01, le=2.0, description="Height of the letters, in the same units as size; null: 0.04 text widths."),
    ] = None
    count: Annotated[int | None, Field(ge=1, le=64, description="The most watermarks to place.")] = None
    color: Annotated[
        str | None, Field(description='Letter colour as "#rrggbb"; null or "none" keeps the surface\'s material.')
    ] = None
    seed: Annotated[int, Field(ge=0, le=2**63 - 1, description="Seed of every random draw.")] = 0
    solver: Annotated[Solver | None, Field(description="How boxes are fitted to the surface.")] = None
    evaluate: Annotated[Evaluate, Field(description="Which metrics the report carries.")] = Evaluate.FULL

    @field_validator("color")
    @classmethod
    def _hex_color(cls, value: str | None) -> str | None:
        if value is None or value == "none":
            return None
        if not re.fullmatch(r"#[0-9a-fA-F]{6}", value):
            raise PydanticCustomError("color", 'Input should be "none" or "#" and six hexadecimal digits')
        return value.lower()

    @model_validator(mode="after")
    def _has_letters(self) -> Self:
        if not self.text.strip():
            raise MeshmarkError(
                ErrorCode.EMPTY_TEXT,
                "The watermark text is empty or only spaces.",
                "Send at least one visible character in `text`.",
            )
        return self

    def relief_at(self, width: float) -> float:
        """Signed height of letters in a text of the given width, size-30 units: sunken ones are negative."""
        height = self.relief if self.relief is not None else RELIEF * width
        return height if self.mode is Mode.EMBOSS else -height

    def resolved(self) -> "Parameters":
        """This request with every ``None`` that the preset decides filled in; ``size`` and ``relief`` may stay so."""
        values = {key: value for key, value in PRESETS[self.preset].items() if getattr(self, key) is None}
        return self.model_copy(update=values)


def parse_parameters(data: dict[str, Any] | str | bytes) -> Parameters:
    """Parameters from a mapping or a JSON text.

    Raises:
        MeshmarkError: ``empty_text`` or ``invalid_parameters``, naming each field and what is wrong with it.
    """
    try:
        if isinstance(data, dict):
            return Parameters.model_validate(data)
        return Parameters.model_validate_json(data)
    except ValidationError as error:
        problems = "; ".join(
            f"{'.'.join(str(part) for part in item['loc']) or 'params'}: {item['msg']}" for item in error.errors()
        )
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"The parameters are not valid: {problems}.",
            "Correct the named fields; the README lists every parameter with its range.",
        ) from None
