"""Copies of a watermark that clients ask for: a text for each buyer, and what they want to find it by."""

import re
from pathlib import PurePath
from typing import Annotated, Any

from pydantic import Field, StringConstraints, TypeAdapter, ValidationError

from core.artwork.layout import set_text
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters, parse_parameters
from core.validation import StrictModel, describe, first_repeat, shortened
from service.jobs.copies import MOST, NewCopy
from service.jobs.models import Job
from service.metadata import parse_metadata

LONGEST = 200  # characters of a text, as in Parameters
NOT_IN_NAMES, LONGEST_NAME = re.compile(r"[^\w.-]+"), 60  # characters of a text that names of files do not have; most
REMEDY = "Send 1 to 1,000 copies, each with its own `text`."


class Copy(StrictModel):
    """A copy to make: the same asset with another text at the same places."""

    text: Annotated[
        str,
        StringConstraints(min_length=1, max_length=LONGEST),
        Field(description="What to emboss in the place of the job's own `text`.", examples=["ORDER-4711"]),
    ]
    metadata: Annotated[dict[str, Any], Field(description="What you want to find the copy by.")] = {}  # noqa: RUF012


Copies = Annotated[list[Copy], Field(min_length=1, max_length=MOST)]
COPIES = TypeAdapter[list[Copy]](Copies)


def parse_copies(text: str | bytes) -> list[Copy]:
    """Copies from a JSON text.

    Raises:
        MeshmarkError: ``invalid_parameters``, naming each field and what is wrong with it.
    """
    try:
        return COPIES.validate_json(text)
    except ValidationError as error:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS, f"The copies are not valid: {describe(error.errors(), 'copies')}.", REMEDY
        ) from None


def check_copies(copies: list[Copy], parameters: Parameters, *, logo: bool, font: bool) -> list[NewCopy]:
    """The copies to make of a job.

    Args:
        copies: as they were sent.
        parameters: of the job.
        logo: whether the job has one.
        font: whether the job has its own; then letters that it lacks are seen only when the copy is made.

    Raises:
        MeshmarkError: ``invalid_parameters``, two texts are alike, or there is nothing to emboss them in;
            ``empty_text``, ``invalid_parameters``, ``missing_glyphs`` or ``invalid_metadata``, naming the copy.
    """
    if parameters.metadata_only:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            "The request has copies and `metadata_only`, which places no marks that could have their texts.",
            "Leave one of them out.",
        )
    if repeat := first_repeat([copy.text for copy in copies]):
        first, again = repeat
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"copies.{again} has the text {shortened(copies[again].text)!r} of copies.{first}: nothing would tell the "
            "two apart.",
            "Give each copy a text of its own.",
        )
    return [_checked(number, copy, parameters, logo, font) for number, copy in enumerate(copies)]


def _checked(number: int, copy: Copy, parameters: Parameters, logo: bool, font: bool) -> NewCopy:
    try:
        wanted = parse_parameters(parameters.model_dump(mode="json") | {"text": copy.text})
        wanted.require_content(logo)
        if not font and (words := wanted.resolved().text).strip():
            set_text(words)
        return NewCopy(copy.text, parse_metadata(copy.metadata))
    except MeshmarkError as error:
        where = f"copies.{number} ({shortened(copy.text)!r}): "
        raise MeshmarkError(error.code, where + error.message, error.remedy) from None


def stem_of(job: Job) -> str:
    """The beginning of the names of a job's results: the asset's own, and of a copy its text as far as names have it,
    so that files of several buyers are told apart."""
    stem = PurePath(job.filename).stem
    text = "" if job.copy_of is None or job.erased else NOT_IN_NAMES.sub("-", str(job.parameters["text"])).strip("-.")
    return f"{stem}-{text[:LONGEST_NAME]}" if text else stem
