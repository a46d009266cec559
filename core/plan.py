"""The placement of a run, ``meshmark.plan/1``: where its marks stand and how they look, for other texts to take.

It is written once and read again, perhaps from a file of somebody else's: what is read is held to its bounds.
"""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from core.validation import describe

SCHEMA: Literal["meshmark.plan/1"] = "meshmark.plan/1"
LARGEST = 2**20  # bytes
MOST_MARKS = 64
VIEWS = 24  # the paper's
FAR = 1e3  # size-30 units from the middle of an asset whose largest side is 30
ORTHONORMAL = 1e-6  # error of the products of axes

Coordinate = Annotated[float, Field(ge=-FAR, le=FAR)]
Point = tuple[Coordinate, Coordinate, Coordinate]
Length = Annotated[float, Field(gt=0, le=FAR)]
Share = Annotated[float, Field(ge=0, le=1)]
Vector = tuple[float, float, float]


class PlanPart(BaseModel):
    """A part of a plan."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class PlannedMark(PlanPart):
    """The place of a mark, in the size-30 frame, and the look of its letters there.

    Attributes:
        center, axes, size: of its box, see :class:`core.geometry.boxes.Boxes`.
        line_height: of the text that the place was chosen for.
        color, glows, contrast, lighter: see :class:`core.analysis.contrast.Look`.
        loss, roughness: of the place, see :class:`core.report.Watermark`.
        views: numbers of the paper's views that see it.
    """

    center: Point
    axes: tuple[Point, Point, Point]
    size: tuple[Length, Length, Length]
    line_height: Length
    color: Annotated[str | None, Field(pattern="^#[0-9a-f]{6}$")]
    glows: bool
    contrast: Annotated[float | None, Field(ge=0, le=FAR)]
    lighter: bool
    loss: Annotated[float, Field(ge=0)]
    roughness: float
    views: Annotated[tuple[Annotated[int, Field(ge=0, lt=VIEWS)], ...], Field(max_length=VIEWS)]

    @model_validator(mode="after")
    def _is_a_frame(self) -> Self:
        axes = np.array(self.axes)
        if np.abs(axes @ axes.T - np.eye(3)).max() > ORTHONORMAL or np.linalg.det(axes) < 0:
            raise ValueError("the axes are not at right angles, of length one and right-handed")
        return self


class Plan(PlanPart):
    """The placement of a run.

    Attributes:
        schema_: which plan this is, and its version.
        engine: the version of Meshmark that made it.
        asset: SHA-256 of the file that it is for.
        parameters: that it was made for, resolved; their text is the one that needs most room.
        offset, scale: of the size-30 frame: size-30 = (world - offset) * scale.
        opaque: least opaque share of a face under letters.
        marks: the places.
    """

    schema_: Annotated[Literal["meshmark.plan/1"], Field(alias="schema")] = SCHEMA
    engine: Annotated[str, Field(max_length=64)]
    asset: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    parameters: Parameters
    offset: Vector
    scale: Annotated[float, Field(gt=0)]
    opaque: Share
    marks: Annotated[tuple[PlannedMark, ...], Field(min_length=1, max_length=MOST_MARKS)]

    def to_json(self) -> bytes:
        """The plan as a file, numbers at full precision."""
        return self.model_dump_json(by_alias=True).encode()


def parse_plan(data: bytes) -> Plan:
    """The plan in a file.

    Raises:
        MeshmarkError: ``invalid_request``.
    """
    try:
        if len(data) > LARGEST:
            raise MeshmarkError(
                ErrorCode.INVALID_REQUEST, f"The plan has {len(data):,} bytes, more than any has.", REMEDY
            )
        return Plan.model_validate_json(data)
    except ValidationError as error:
        raise MeshmarkError(
            ErrorCode.INVALID_REQUEST, f"The plan is not valid: {describe(error.errors(), 'plan')}.", REMEDY
        ) from None


REMEDY = "Mark the asset anew, and take the plan of that job as it is."
