"""Parameters of a request. Lengths are in the size-30 frame (see ``core``)."""

import re
from typing import Annotated, Any

from pydantic import ConfigDict, Field, ValidationError, field_validator
from pydantic_core import PydanticCustomError

from core.choices import (
    Align,
    Direction,
    Evaluate,
    FileFormat,
    LogoPosition,
    Mode,
    Preset,
    Profile,
    Solver,
    Strength,
    UnmarkedCopies,
    Wrap,
)
from core.errors import ErrorCode, MeshmarkError
from core.labels.profiles import Label
from core.labels.wording import Wording
from core.languages import language_tag
from core.named_regions import Region
from core.preview_model import PreviewModel
from core.validation import describe

MAX_QR_LENGTH = 300
MAX_REGIONS = 32
MAX_COLORS = 16
MIN_SIZE = 0.5
NO_LOGO = "Send the logo as a file with the asset; a batch and an upload hook take none: use `qr`, or a text alone."
AUTO, NO_COLOR = "auto", "none"
# Colours for letters of `color: auto`, of which one stands out from any ground: black, white, and strong hues.
AUTO_COLORS = ("#101010", "#f8f8f8", "#d02020", "#ffd400", "#1840d0", "#00a040", "#d000a0", "#00c8e0")
# Relief, as a share of the letters' height. OCR of uncoloured letters on twelve assets is 0.79 at 0.32, 0.80 at 0.24,
# 0.82 at 0.16 and 0.78 at 0.12, while the change of the shape is proportional to it.
RELIEF = 0.158
# Size-30 units; letters of a label that are higher, because its rule says so, rise no more: they are read anyway.
LABEL_HEIGHT = 0.8

# Text width and whether it is the only one, relief, number, solver, colour, profile. "paper" repeats the supplement's
# implementation details (extrude strength 0.05, about ten watermarks, Adam). In the other two the relief grows with the
# text: see `relief_at`.
_OURS = {
    "size_exact": False,
    "solver": Solver.LEVENBERG_MARQUARDT,
    "color": AUTO,
    "profile": Profile.SOFT,
}
PRESETS: dict[Preset, dict[str, Any]] = {
    Preset.MERCHANDISE: _OURS | {"size": None, "count": 16},
    Preset.PROVENANCE: _OURS | {"size": 3.0, "count": 4, "label": Label.CUSTOM},
    Preset.PAPER: {
        "size": 5.5,
        "size_exact": True,
        "relief": 0.05,
        "count": 10,
        "solver": Solver.ADAM,
        "color": NO_COLOR,
        "profile": Profile.FLAT,
    },
}

# What a strength puts in the place of the preset's values. The widths that are tried, and what a mark costs, go with
# it: :func:`core.placement.options.tuned`.
STRENGTHS: dict[Strength, dict[str, Any]] = {
    Strength.DISCREET: {"size": None, "count": 6},
    Strength.STANDARD: {},
    Strength.STRONG: {"size": None, "count": 24},
}


def _hex_color(value: Any) -> str:
    if not isinstance(value, str) or not re.fullmatch(r"#[0-9a-fA-F]{6}", value):
        raise PydanticCustomError(
            "color", 'Input should be "auto", "none", "#" and six hexadecimal digits, or a list of such colours'
        )
    return value.lower()


class Parameters(Wording):
    """One watermarking request. ``None`` means "what the preset says"; :meth:`resolved` fills it in."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    qr: Annotated[
        str | None,
        Field(
            max_length=MAX_QR_LENGTH,
            description="A web address, embossed as a QR code; it takes the place of a logo.",
            examples=["https://example.com/4711"],
        ),
    ] = None
    logo_position: Annotated[LogoPosition, Field(description="Where a logo or a QR code stands by the text.")] = (
        LogoPosition.LEFT
    )
    wrap: Annotated[
        Wrap,
        Field(
            description="Set a text without line breaks in one to four lines, as each place has room, or in one only."
        ),
    ] = Wrap.AUTO
    align: Annotated[
        Align,
        Field(description="Where shorter lines of the text stand; of vertical ones, left is the top."),
    ] = Align.CENTER
    line_spacing: Annotated[
        float, Field(ge=0.8, le=3.0, description="From one line to the next, in ems; more where letters would touch.")
    ] = 1.2
    letter_spacing: Annotated[
        float, Field(ge=0.0, le=1.0, description="Added between letters, in ems; not where a script joins them.")
    ] = 0.0
    direction: Annotated[
        Direction,
        Field(
            description="Lines from left to right and back, or columns from the top down, for Chinese and the like; "
            "auto: as each place has room."
        ),
    ] = Direction.HORIZONTAL
    language: Annotated[
        str | None,
        Field(
            description="Language of the text (BCP 47), which decides the shapes of ideographs: zh-Hans, zh-Hant, ja, "
            "ko, ...; null: guessed."
        ),
    ] = None
    preset: Annotated[Preset, Field(description="Starting values for size, relief, count and solver.")] = (
        Preset.MERCHANDISE
    )
    strength: Annotated[
        Strength,
        Field(
            description="discreet: few small marks, which label; strong: large ones, up to a width of 14, which deter, "
            "at a greater change of the shape. What is given as size, relief or count wins."
        ),
    ] = Strength.STANDARD
    mode: Annotated[Mode, Field(description="Raised (emboss) or sunken (deboss) letters.")] = Mode.EMBOSS
    profile: Annotated[
        Profile | None,
        Field(
            description="soft: letters rise smoothly out of the surface, with a shallow trench round them; flat: they "
            "have level tops and edges. null: the preset's; a QR code is always flat."
        ),
    ] = None
    size: Annotated[
        float | None,
        Field(
            ge=MIN_SIZE,
            le=30.0,
            description="Text width where the asset's largest side is 30, at most; null: as wide as reads well.",
        ),
    ] = None
    size_exact: Annotated[bool | None, Field(description="All marks as wide as `size`; null: the preset's.")] = None
    relief: Annotated[
        float | None,
        Field(
            ge=0.01,
            le=2.0,
            description="How far letters stand out, in the same units as size; null: 0.158 of the text's height.",
        ),
    ] = None
    count: Annotated[int | None, Field(ge=1, le=64, description="The most watermarks to place.")] = None
    color: Annotated[
        str | tuple[str, ...] | None,
        Field(
            max_length=MAX_COLORS,
            description='Letter colour as "#rrggbb"; a list, or "auto" for a built-in one: of it each mark has the '
            "colour that stands out best; \"none\" keeps the surface's material; null: the preset's.",
        ),
    ] = None
    seed: Annotated[int, Field(ge=0, le=2**63 - 1, description="Seed of every random draw.")] = 0
    keep_out: Annotated[
        list[Region],
        Field(max_length=MAX_REGIONS, description="Where no watermark may stand, by node, material or box."),
    ] = []  # noqa: RUF012 - pydantic copies it, and OpenAPI shows it
    prefer: Annotated[
        list[Region],
        Field(
            max_length=MAX_REGIONS,
            description="Where watermarks should rather stand. What is kept out stays out.",
        ),
    ] = []  # noqa: RUF012 - as above
    solver: Annotated[Solver | None, Field(description="How boxes are fitted to the surface.")] = None
    unmarked_copies: Annotated[
        UnmarkedCopies,
        Field(
            description="Other scenes, levels of detail and unused meshes that cannot be marked: left out of the "
            "result, or kept as they are."
        ),
    ] = UnmarkedCopies.LEAVE_OUT
    format: Annotated[
        FileFormat,
        Field(
            description="Format of a further result beside the GLB: that of the upload (same), STL, OBJ in a ZIP, PLY "
            "or 3MF; glb: none."
        ),
    ] = FileFormat.GLB
    evaluate: Annotated[Evaluate, Field(description="Which metrics the report carries.")] = Evaluate.FULL
    explain: Annotated[
        bool,
        Field(
            description="Also tell why marks stand where they stand: figures, and a model with the boxes of each step."
        ),
    ] = False
    turntable: Annotated[
        bool,
        Field(description="Render the result as it turns once: an animated WebP, and its first frame."),
    ] = False
    preview_model: Annotated[
        PreviewModel | None,
        Field(
            description="Also make a light model for public display, with fewer triangles and smaller images, and the "
            "same marks; null: none."
        ),
    ] = None

    @field_validator("color", mode="before")
    @classmethod
    def _hex_colors(cls, value: Any) -> Any:
        if value is None or value == NO_COLOR:
            return value
        if isinstance(value, list | tuple):
            if not 1 <= len(value) <= MAX_COLORS:
                raise PydanticCustomError("color", f"Input should have 1 to {MAX_COLORS} colours, not {len(value)}")
            return tuple(map(_hex_color, value))
        return value if value == AUTO else _hex_color(value)

    @field_validator("language")
    @classmethod
    def _known_language(cls, value: str | None) -> str | None:
        if value is None or (tag := language_tag(value)):
            return None if value is None else tag
        raise PydanticCustomError("language", "Input should be a language tag such as zh-Hans, zh-Hant, ja, ko or en")

    @field_validator("qr")
    @classmethod
    def _web_address(cls, value: str | None) -> str | None:
        if value is not None and not re.fullmatch(r"https?://[!-~]+", value):
            raise PydanticCustomError("qr", "Input should be an address that starts with https://, in ASCII")
        return value

    def require_content(self, logo: bool) -> None:
        """Refuse a request for nothing, without a text, a QR code and a ``logo``; for both a QR code and a logo; for a
        code with a soft profile; for an exact size that is not given; for another strength than the paper's; for the
        place of a logo that is not there; for a label that its text does not say; or for reasons of marks, or a preview
        model with marks, that it does not ask for.

        Raises:
            MeshmarkError: ``empty_text``, ``invalid_parameters``.
        """
        resolved = self.resolved()
        resolved.require_label()
        if logo and self.qr is not None:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                "The request has both a logo and `qr`, which takes a logo's place.",
                "Send one of them only.",
            )
        if not (logo or self.qr or resolved.text.strip() or self.metadata_only):
            raise MeshmarkError(
                ErrorCode.EMPTY_TEXT,
                "The watermark text is empty or only spaces, and there is no logo.",
                "Send at least one visible character in `text`, an address in `qr`, or a logo.",
            )
        if self.qr is not None and self.profile is Profile.SOFT:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                'The request has `qr` and a `profile` of "soft", which would round the modules of the code.',
                'Leave `profile` out, or send "flat".',
            )
        if self.size_exact and resolved.size is None:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                "The request has `size_exact`, but no `size` that all marks should have.",
                "Send a `size`, or leave `size_exact` out.",
            )
        if self.preset is Preset.PAPER and self.strength is not Strength.STANDARD:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f'The request has the preset "paper", whose size and number are the paper\'s, and a `strength` of '
                f'"{self.strength}".',
                "Leave one of them out.",
            )
        if self.explain and self.metadata_only:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                "The request has `explain` and `metadata_only`, which places no marks that could be explained.",
                "Leave one of them out.",
            )
        if self.preview_model is not None and self.preview_model.alone and self.explain:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                "The request has `explain`, whose model shows the whole shape, and a `preview_model` that is to be "
                "`alone`.",
                "Leave one of them out.",
            )
        if self.preview_model is not None and self.preview_model.alone and self.format is not FileFormat.GLB:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f"The request has a `format` of {self.format}, whose file has the whole shape, and a `preview_model` "
                "that is to be `alone`.",
                "Leave one of them out.",
            )
        if self.preview_model is not None and self.metadata_only:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                "The request has `preview_model` and `metadata_only`, which embosses no marks that it could carry.",
                "Leave one of them out.",
            )
        if self.logo_position is not LogoPosition.LEFT and not (logo or self.qr):
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f'The request has a `logo_position` of "{self.logo_position}", but neither a logo nor `qr`.',
                NO_LOGO,
            )

    @property
    def palette(self) -> tuple[str, ...]:
        """The colours that letters may have, "#rrggbb"; none where they keep that of the surface."""
        if self.color is None or self.color == NO_COLOR:
            return ()
        if isinstance(self.color, tuple):
            return self.color
        return AUTO_COLORS if self.color == AUTO else (self.color,)

    def relief_at(self, height: float) -> float:
        """Signed relief of letters in a text of the given ``height``, size-30 units: sunken ones are negative."""
        usual = RELIEF * (height if self.rule is None else min(height, LABEL_HEIGHT))
        relief = self.relief if self.relief is not None else usual
        return relief if self.mode is Mode.EMBOSS else -relief

    def resolved(self) -> "Parameters":
        """This request with every ``None`` that the preset decides filled in; ``size`` and ``relief`` may stay so."""
        preset = PRESETS[self.preset] | STRENGTHS[self.strength]
        preset |= {"profile": Profile.FLAT} if self.qr is not None else {}
        preset |= {} if self.preset is Preset.PAPER else self.label_preset(preset.get("label"))
        values = {key: value for key, value in preset.items() if getattr(self, key) is None}
        values |= self.label_values(preset.get("label"))
        return self.model_copy(update=values | ({"evaluate": Evaluate.NONE} if self.metadata_only else {}))


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
        correct = "Correct the named fields; the manual's page on parameters has each with its range."
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"The parameters are not valid: {describe(error.errors(), 'params')}.",
            NO_LOGO if any(fault["loc"] == ("logo",) for fault in error.errors()) else correct,
        ) from None
