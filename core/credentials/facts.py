"""Outcome of reading a file's Content Credentials, as a report has it."""

from enum import StrEnum
from typing import Annotated

from pydantic import Field

from core.report import Section

LONGEST_SIDECAR = 2**24  # bytes of a manifest store that is read


class CredentialState(StrEnum):
    """Outcome of judging a file by its credentials."""

    TRUSTED = "trusted"
    VALID = "valid"
    EXPIRED = "expired"
    TAMPERED = "tampered"
    ABSENT = "absent"


class Credentials(Section):
    """Content Credentials of the file that was sent."""

    state: Annotated[
        CredentialState,
        Field(
            description="`trusted`: they fit the file, and a certificate that is trusted here signed them; `valid`: "
            "they fit it, and the certificate is not among the trusted; `expired`: they fit it, and the certificate "
            "was out of date; `tampered`: the file is not the one they were made for, or they were changed; `absent`: "
            "there are none."
        ),
    ]
    codes: Annotated[list[str], Field(description="Failures, by C2PA's names, such as `assertion.dataHash.mismatch`.")]
    issuer: Annotated[str | None, Field(description="The organisation of the signer's certificate.")] = None
    name: Annotated[str | None, Field(description="The common name of the signer's certificate.")] = None
    time: Annotated[str | None, Field(description="When they were signed, by a server of time stamps.")] = None
    generator: Annotated[str | None, Field(description="The program that they say made the file.")] = None
    title: Annotated[str | None, Field(description="The name that they give the file.")] = None
    source_type: Annotated[str | None, Field(description="The IPTC's address of how it came about, by them.")] = None
    actions: Annotated[tuple[str, ...], Field(description="What they say was done, by C2PA's names.")] = ()
    marks: Annotated[tuple[str, ...], Field(description="The texts of the marks that Meshmark's statement names.")] = ()


ABSENT = Credentials(state=CredentialState.ABSENT, codes=[])
