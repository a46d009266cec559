"""A caller's declaration of where a model comes from. Nothing in it is ever made up."""

from datetime import datetime
from enum import StrEnum
from typing import Annotated, Any

from pydantic import AfterValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

from core.validation import StrictModel

LONGEST, LONGEST_CODE = 500, 4096


class SourceType(StrEnum):
    """How a model came about, in the words of the IPTC (newscodes, digitalsourcetype)."""

    TRAINED_ALGORITHMIC_MEDIA = "trainedAlgorithmicMedia"
    COMPOSITE_WITH_TRAINED_ALGORITHMIC_MEDIA = "compositeWithTrainedAlgorithmicMedia"
    ALGORITHMIC_MEDIA = "algorithmicMedia"
    DIGITAL_CREATION = "digitalCreation"
    HUMAN_EDITS = "humanEdits"

    @property
    def uri(self) -> str:
        """Its address in the IPTC's vocabulary."""
        return f"http://cv.iptc.org/newscodes/digitalsourcetype/{self.value}"


def _date(value: str) -> str:
    try:
        datetime.fromisoformat(value)
    except ValueError:
        raise PydanticCustomError("date", "Input should be a date or a time such as 2026-11-30T12:00:00Z") from None
    return value


def _printable(value: str) -> str:
    if not value.isprintable():
        raise PydanticCustomError("printable", "Input should be one line, without control characters")
    return value


Line = Annotated[str, Field(min_length=1, max_length=LONGEST), AfterValidator(_printable)]
Code = Annotated[str, Field(max_length=LONGEST_CODE), AfterValidator(_printable)]
Date = Annotated[str, Field(min_length=8, max_length=40), AfterValidator(_date)]


class Aigc(StrictModel):
    """The seven fields of the label that GB 45438-2025 asks for in the metadata of a file (its appendix E)."""

    model_config = ConfigDict(frozen=True)

    label: Annotated[
        str, Field(pattern="^[123]$", description="The model is (1), may be (2), or is suspected to be (3) generated.")
    ] = "1"
    content_producer: Annotated[Code, Field(description="Name or code of the provider that generated the model.")] = ""
    produce_id: Annotated[Code, Field(description="The provider's number for it.")] = ""
    reserved_code1: Annotated[Code, Field(description="The provider's own security data.")] = ""
    content_propagator: Annotated[Code, Field(description="Name or code of the platform that distributes it.")] = ""
    propagate_id: Annotated[Code, Field(description="The platform's number for it.")] = ""
    reserved_code2: Annotated[Code, Field(description="The platform's own security data.")] = ""

    def named(self) -> dict[str, str]:
        """The fields by the names that the standard gives them."""
        return {self.title(name): str(value) for name, value in self.model_dump().items()}

    @staticmethod
    def title(name: str) -> str:
        """The name that the standard gives a field."""
        return "".join("ID" if part == "id" else part.capitalize() for part in name.split("_"))


PROPAGATOR = ("ContentPropagator", "PropagateID", "ReservedCode2")  # the fields of Aigc that a distributor fills


class Declaration(StrictModel):
    """Statements about the model, written into the result as they are given."""

    model_config = ConfigDict(
        frozen=True,
        json_schema_extra={"examples": [{"creator": "Example Ltd", "system": "Forge", "system_version": "3.1"}]},
    )

    source_type: Annotated[
        SourceType | None, Field(description="How the model came about; null: as the label's profile says.")
    ] = None
    creator: Annotated[Line | None, Field(description="Person or provider that made it.")] = None
    title: Annotated[Line | None, Field(description="Its title.")] = None
    rights: Annotated[Line | None, Field(description="A statement of rights or licence.")] = None
    identifier: Annotated[Line | None, Field(description="Its unique identifier at the provider's.")] = None
    system: Annotated[Line | None, Field(description="Name of the system that generated it.")] = None
    system_version: Annotated[Line | None, Field(description="Version of that system.")] = None
    created: Annotated[Date | None, Field(description="When it was made (RFC 3339); null: not said.")] = None
    modified: Annotated[Date | None, Field(description="When it was last changed (RFC 3339); null: not said.")] = None
    aigc: Annotated[
        Aigc | None, Field(description="China's label; null: its fields stay empty where the label's profile has it.")
    ] = None

    def given(self) -> dict[str, Any]:
        """The statements that were made, by name."""
        return self.model_dump(exclude_none=True)
