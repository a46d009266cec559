"""Parameters of a verification."""

from typing import Annotated, Any

from pydantic import ConfigDict, Field, StringConstraints, ValidationError

from core.errors import ErrorCode, MeshmarkError
from core.labels.wording import MAX_TEXT_LENGTH
from core.validation import StrictModel, describe

MOST_TEXTS = 32

KnownText = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=MAX_TEXT_LENGTH)]


class VerificationParameters(StrictModel):
    """One request for a verification."""

    model_config = ConfigDict(frozen=True)

    texts: Annotated[
        tuple[KnownText, ...] | None,
        Field(
            max_length=MOST_TEXTS,
            description="Known texts that marks may say; null: those of your own latest watermarks, or where you have "
            "none, as []: anything that is read with confidence.",
            examples=[["SAMPLE"]],
        ),
    ] = None
    watermark: Annotated[
        str | None,
        StringConstraints(pattern=r"^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$"),
        Field(
            description="Id of a watermark job of yours: the file is compared with that job's asset and report, whose "
            "texts are the known ones.",
            examples=["6f1c2f0e-53a5-4f6e-9f39-0d2b1a7c9d11"],
        ),
    ] = None
    keep: Annotated[
        bool,
        Field(
            strict=True,
            description="Keep the files that were sent with the results; else they are deleted when the job ends.",
        ),
    ] = False


def parse_verification(data: dict[str, Any] | str | bytes) -> VerificationParameters:
    """Parameters from a mapping or a JSON text.

    Raises:
        MeshmarkError: ``invalid_parameters``, naming each field and what is wrong with it.
    """
    try:
        if isinstance(data, dict):
            return VerificationParameters.model_validate(data)
        return VerificationParameters.model_validate_json(data)
    except ValidationError as error:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"The parameters are not valid: {describe(error.errors(), 'params')}.",
            "Correct the named fields; the manual's page on verification has each.",
        ) from None
