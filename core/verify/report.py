"""Report of a verification."""

from typing import Annotated, Literal

from pydantic import Field

from core.credentials.facts import Credentials
from core.notices import Notice
from core.report import Engine, FileFacts, Section, Vector

# Of a picture: as a viewer shows the file, or of its shape alone, its folds and ridges or what stands out of it.
Kind = Literal["ordinary", "relief", "height"]


class ReadMark(Section):
    """Writing that was read: on the surface of a model, in its own world coordinates, or in a picture."""

    text: Annotated[str, Field(description="As it was read.")]
    known: Annotated[str | None, Field(description="The known text that it is; null where none was given.")]
    likeness: Annotated[float, Field(description="Ratio of both texts without regard to case and spaces, 0 to 1.")]
    confidence: Annotated[float, Field(description="Of the text recognition, mean over its letters, 0 to 1.")]
    votes: Annotated[int, Field(description="Pictures that read it.")]
    pictures: Annotated[
        list[Kind],
        Field(
            description="Their kinds: as a viewer shows the file (ordinary), and of its shape alone (relief, height)."
        ),
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


class ComparedMark(Section):
    """Relief of a mark over the original's surface."""

    index: Annotated[
        int, Field(description="`id` of the mark in the job's report; without one, its place in `marks`, from 0 on.")
    ]
    text: Annotated[str, Field(description="The text that it says.")]
    present: Annotated[
        bool | None,
        Field(
            description="Whether it stands there; null without a report, and where too little of the surface is left."
        ),
    ] = None
    correlation: Annotated[
        float | None,
        Field(
            description="Likeness of the relief to the artwork, 0 to 1; null without a report, and for artwork that it "
            "does not hold (a logo or a font that was sent)."
        ),
    ] = None
    standing_out: Annotated[
        float | None,
        Field(
            description="Share of its box that stands out of the original, or lies in it, by a quarter of the mark's "
            "height or more; null without a report."
        ),
    ] = None
    height: Annotated[
        float, Field(description="Height there over the original, world units of that; negative for sunken letters.")
    ]
    surface: Annotated[float, Field(description="Share of its box where both files have a surface.")]


class Comparison(Section):
    """A suspect file against an original."""

    file: Annotated[FileFacts, Field(description="The original.")]
    is_asset: Annotated[
        bool | None,
        Field(description="Whether it is the very file that the job marked, by its SHA-256; null without a report."),
    ]
    is_result: Annotated[
        bool | None,
        Field(description="Whether the suspect is the very result of the job, by its SHA-256; null without a report."),
    ]
    scale: Annotated[
        float, Field(description="World coordinates of the original are scale * rotation * suspect + translation.")
    ]
    rotation: Annotated[tuple[Vector, Vector, Vector], Field(description="The rows of a matrix.")]
    translation: Annotated[Vector, Field(description="World units of the original.")]
    residual: Annotated[
        float,
        Field(
            description="Root mean square distance of the nearest four fifths of the suspect's surface to the "
            "original's, over the suspect's radius."
        ),
    ]
    covered: Annotated[float, Field(description="Share of the original's surface that the suspect lies near.")]
    marks: Annotated[
        list[ComparedMark], Field(description="The marks of the job's report; without one, those that were read.")
    ]


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
    original: Annotated[
        Comparison | None, Field(description="The comparison with an original; null where none was given.")
    ] = None
    warnings: Annotated[list[Notice], Field(description="What could not be looked for.")]
    timings: Annotated[dict[str, float], Field(description="Seconds of each step.")]
