"""What clients may note about a job: a few short strings by name, kept and given back as they are."""

from itertools import groupby
from typing import Annotated, Any

from pydantic import Field, StringConstraints, TypeAdapter, ValidationError

from core.errors import ErrorCode, MeshmarkError

Key = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.-]{1,40}$")]
Value = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f]{0,256}$")]  # PostgreSQL keeps no NUL
Metadata = Annotated[dict[Key, Value], Field(max_length=16)]

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
        problems = "; ".join(
            f"{'.'.join(str(part) for part, _ in groupby(item['loc'])) or 'metadata'}: {item['msg']}"
            for item in error.errors()
        )
        raise MeshmarkError(
            ErrorCode.INVALID_METADATA,
            f"The metadata is not valid: {problems}.",
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
        ErrorCode.INVALID_METADATA,
        "The filter by metadata is not a pair of a name and a value.",
        "Write it as `name:value`.",
    )
