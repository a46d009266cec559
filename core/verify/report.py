"""Report of a verification."""

from typing import Annotated, Literal

from pydantic import Field

from core.credentials.facts import Credentials
from core.notices import Notice
from core.report import Engine, FileFacts, Section, Vector

Kind = Literal["ordinary", "relief"]  # of a picture: as a viewer shows the file, or of its shape alone


class ReadMark(Section):
    """Writing that was read: on the surface of a model, in its own world coordinates, or in a picture."""

    text: Annotated[str, Field(description="As it was read.")]
    known: Annotated[str | None, Field(description="The known text that it is; null where none was given.")]
    likeness: Annotated[float, Field(description="Ratio of both texts without regard to case and spaces, 0 to 1.")]
    confidence: Annotated[float, Field(description="Of the text recognition, mean over its letters, 0 to 1.")]
    votes: Annotated[int, Field(description="Pictures that read it.")]
    pictures: Annotated[
        list[Kind], Field(description="Their kinds: as a viewer shows the file, and of its shape alone (relief).")
    ]
    center: Annotated[Vector | None, Field(description="The middle of the writing; null in a picture.")] = None
    right: Annotated[
        Vector | None, Field(description="The direction of reading, a unit vector; null in a picture.")
    ] = None
    normal: Annotated[
        Vector | None, Field(description="The direction that it is read from, a unit vector; null in a picture.")
    ] = None
    length: Annotated[float | None, Field(description="Length of the line, world units; null in a picture.")] = None
    pixel: Annotated[
        tuple[float, float] | None,
        Field(description="The middle of the writing in a picture, to the right and down; null on a model."),
    ] = None


class AigcLabel(Section):
    """China's label, as it is in the file."""

    fields: Annotated[dict[str, str] | None, Field(description="By the names of GB 45438; null where it is no JSON.")]
    text: Annotated[str | None, Field(description="As it is, where it is no JSON.")]


class FileLabel(Section):
    """Statements of the file's metadata about all of it; null where it makes none."""

    source_type: Annotated[str | None, Field(description="The IPTC's address of how the model came about.")]
    title: Annotated[str | None, Field(description="Its title.")]
    rights: Annotated[str | None, Field(description="A statement of rights.")]
    creator: Annotated[str | None, Field(description="Who made it; the first of several.")]
    identifier: Annotated[str | None, Field(description="Its identifier at whoever made it.")]
    created: Annotated[str | None, Field(description="When it was made, as it is written there.")]
    modified: Annotated[str | None, Field(description="When it was last changed, as it is written there.")]
    system: Annotated[str | None, Field(description="The system that generated it.")]
    system_version: Annotated[str | None, Field(description="The version of that system.")]
    aigc: Annotated[list[AigcLabel], Field(description="China's labels; a file should have one at most.")]
    copyright: Annotated[str | None, Field(description="`asset.copyright` of the glTF.")]


class VerificationReport(Section):
    """Marks and labels that were found in a file."""

    schema_: Annotated[
        Literal["meshmark.verification/1"], Field(alias="schema", description="Which report this is, and its version.")
    ] = "meshmark.verification/1"
    file: Annotated[FileFacts, Field(description="The file that was sent.")]
    engine: Engine
    texts: Annotated[list[str], Field(description="The known texts that were looked for.")]
    found: Annotated[
        list[str] | None, Field(description="Those of them that were read; null where none were looked for.")
    ]
    marks: Annotated[list[ReadMark], Field(description="What was read, the surest first.")]
    label: Annotated[FileLabel | None, Field(description="Null where the metadata say nothing.")]
    credentials: Annotated[
        Credentials | None, Field(description="Null where the library that reads them is not installed.")
    ]
    warnings: Annotated[list[Notice], Field(description="What could not be looked for.")]
    timings: Annotated[dict[str, float], Field(description="Seconds of each step.")]
