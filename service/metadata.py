"""Metadata of jobs: a few short strings by name, noted by clients and given back unchanged."""

from typing import Annotated, Any

from pydantic import BeforeValidator, StringConstraints, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from core.errors import MeshmarkError
from core.validation import describe
from service.errors import ServiceErrorCode

MOST = 16  # entries of one job

Key = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.-]{1,40}$")]
Value = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]{0,256}$")]  # PostgreSQL keeps no NUL


def _check_number(data: object) -> object:
    """Check the number of entries before each of them is validated."""
    if isinstance(data, dict) and len(data) > MOST:
        raise PydanticCustomError("too_many_keys", "Object should have at most 16 keys")
    return data


Metadata = Annotated[dict[Key, Value], BeforeValidator(_check_number)]

PAIR = r"^[A-Za-z0-9_.-]{1,40}:[^\x00-\x1f\x7f]{0,256}$"  # of both, for OpenAPI
METADATA = TypeAdapter[dict[str, str]](Metadata)


def parse_metadata(data: str | dict[str, Any]) -> dict[str, str]:
    """Metadata from a mapping or a JSON text.

    Raises:
        MeshmarkError: ``invalid_metadata``.
    """
    try:
        if isinstance(data, dict):
            return METADATA.validate_python(data, strict=True)
        return METADATA.validate_json(data, strict=True)
    except ValidationError as error:
        raise MeshmarkError(
            ServiceErrorCode.INVALID_METADATA,
            f"The metadata is not valid: {describe(error.errors(), 'metadata')}.",
            "Send a JSON object of at most 16 strings of 256 characters, each under a name of at most 40 letters, "
            "digits, dots, hyphens and underscores.",
        ) from None


def parse_pair(text: str) -> tuple[str, str]:
    """The name and value in `name:value`.

    Raises:
        MeshmarkError: ``invalid_metadata``.
    """
    key, colon, value = text.partition(":")
    try:
        if colon:
            METADATA.validate_python({key: value})
            return key, value
    except ValidationError:
        pass
    raise MeshmarkError(
        ServiceErrorCode.INVALID_METADATA,
        "The filter by metadata is not a pair of a name and a value.",
        "Write it as `name:value`.",
    )
