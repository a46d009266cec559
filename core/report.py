"""The report, ``meshmark.report/1``, as it is written and read: what was done, where, and what it cost the asset.

Fields are only added to it. A reader passes over those it does not know (``Report.model_validate_json(data,
extra="ignore")``), and the JSON Schema allows them; whoever writes uses no others.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from core.artwork.artwork import Logo
from core.embossing.refusal import Refusal
from core.gltf.colored_by import ColoredBy
from core.notices import Notice
from core.parameters import Parameters

SCHEMA: Literal["meshmark.report/1"] = "meshmark.report/1"

Vector = tuple[float, float, float]
Score = float | None


def _allow_more(schema: dict[str, Any]) -> None:
    schema.pop("additionalProperties", None)


class Section(BaseModel):
    """A part of a report."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        serialize_by_alias=True,
        json_schema_serialization_defaults_required=True,
        json_schema_extra=_allow_more,
    )


class FileFacts(Section):
    """A file, as it was sent or written."""

    sha256: Annotated[str, Field(description="SHA-256 of its bytes, hexadecimal.")]
    bytes: Annotated[int, Field(description="Its size.")]
    format: Annotated[str, Field(description="Its format, with `+zip` where it came in an archive.", examples=["glb"])]


class AssetFacts(FileFacts):
    """A file and the surface in it: what its default scene shows."""

    vertices: Annotated[int, Field(description="Vertices that are drawn; at seams as often as the file has them.")]
    faces: Annotated[int, Field(description="Triangles.")]
    components: Annotated[int, Field(description="Parts whose faces are connected by shared edges.")]
    watertight: Annotated[bool, Field(description="Whether every edge has exactly two faces.")]
    boundary_edges: Annotated[int, Field(description="Edges with one face.")]
    nonmanifold_edges: Annotated[int, Field(description="Edges with more than two faces.")]


class ExportFacts(FileFacts):
    """The result in another format, beside the GLB."""

    unit: Annotated[
        Literal["micron", "millimeter", "centimeter", "inch", "foot", "meter"] | None,
        Field(description="Of its coordinates; null where the file that was sent says none, and its numbers are kept."),
    ]
    up: Annotated[Literal["y", "z"] | None, Field(description="Its upward axis; null likewise.")]
    left_out: Annotated[list[str], Field(description="What the GLB has and this format cannot hold, in words.")]


class Engine(Section):
    """The program that made the report."""

    version: Annotated[str, Field(description="The version of Meshmark.")]
    device: Annotated[str, Field(description="Where placement was computed.", examples=["cpu", "cuda"])]


class Frame(Section):
    """The size-30 frame, in which the asset's largest side is 30: size-30 = (world - offset) * scale."""

    model_size: Annotated[float, Field(description="The asset's largest side: 30.")]
    scale: Annotated[float, Field(description="Size-30 units a world unit.")]
    offset: Annotated[Vector, Field(description="The frame's origin in world coordinates.")]


class Eye(Section):
    """The cameras that marks are placed for, that visibility is measured from and that pictures are taken by."""

    distance: Annotated[float, Field(description="From the middle of the size-30 frame, size-30 units.")]
    fov: Annotated[float, Field(description="Angle of the pictures from side to side, degrees: the whole asset fits.")]


class Watermark(Section):
    """A mark, in the asset's world coordinates."""

    id: Annotated[int, Field(description="Its number.")]
    text: Annotated[str, Field(description="What it says.")]
    lines: Annotated[list[str], Field(description="The lines that it is set in.")]
    logo: Annotated[
        Logo | None,
        Field(description="Alone or beside the text: a logo (svg) or a QR code (qr); null: neither."),
    ]
    center: Annotated[Vector, Field(description="The centre of its box.")]
    right: Annotated[Vector, Field(description="The direction of the text, a unit vector.")]
    up: Annotated[Vector, Field(description="The direction of the letters' ascenders, a unit vector.")]
    normal: Annotated[Vector, Field(description="The direction it is read from, a unit vector.")]
    size: Annotated[Vector, Field(description="Width and height of the text, depth of its letters; world units.")]
    color: Annotated[str | None, Field(description='Of its letters, "#rrggbb"; null: that of the surface.')]
    contrast: Annotated[
        float | None,
        Field(description="Distance of that colour from what lies under and round it, CIELAB; null without a colour."),
    ]
    colored_by: Annotated[
        ColoredBy | None,
        Field(
            description="How the file holds that colour: in vertex colours of the asset's own primitive; with texture "
            "coordinates on an even texel of its own texture besides; or, where neither shows, in a material of its "
            "own. Null without a colour."
        ),
    ] = None
    color_error: Annotated[
        float | None,
        Field(description="CIELAB distance of the colour in the file from `color`, at most 8; null without a colour."),
    ] = None
    relief: Annotated[float, Field(description="Height of its letters, world units.")]
    loss: Annotated[
        float, Field(description="Mean squared distance of its outline to the surface, squared size-30 units.")
    ]
    roughness: Annotated[float, Field(description="Mean of 1/cos over pairs of normals in the box; 1 is flat.")]
    saliency: Annotated[Score, Field(description="Mean saliency under the box, 0 to 1; null where not measured.")]
    placement_score: Annotated[float, Field(description="`wps_area` of this mark, a share.")]
    views: Annotated[int, Field(description="Of the paper's 24 views, those that see it.")]
    cut: Annotated[
        Literal["split", "arrangement", "delaunay"],
        Field(description="How it was cut into the surface; delaunay: triangulated along letters of a soft profile."),
    ]
    drawn: Annotated[Literal[True], Field(description="A viewer draws its letters: no other mark stays in the file.")]


class CopyFacts(Section):
    """The outcome for another copy of the asset in its file."""

    kind: Annotated[
        Literal["hidden_nodes", "level_of_detail", "scene", "unused_nodes", "unused_meshes"],
        Field(description="What holds it; hidden nodes are those of the default scene."),
    ]
    name: Annotated[str, Field(description="Of the scene, or of the level's node; empty where it has none.")]
    watermarks: Annotated[int, Field(description="How many of the marks were embossed in it.")]
    outcome: Annotated[
        Literal["marked", "shared", "unmarked", "left_out"],
        Field(description="Shared: its meshes are the asset's own. Unmarked: kept as it is."),
    ]


class FontFacts(Section):
    """A font that letters of the marks come from."""

    name: Annotated[str, Field(description="Its full name, as it says itself.", examples=["DejaVu Sans Bold"])]
    version: Annotated[str, Field(description="Its version, as it says itself.", examples=["2.37"])]
    thickened: Annotated[
        float, Field(description="How far its outlines were moved outwards, in ems: not 0 where it has no bold face.")
    ]


class Embossing(Section):
    """The number of places where a mark was to be cut."""

    tried: Annotated[
        int, Field(description="Places where a cut was tried; candidates dropped by filters are not counted.")
    ]
    verified: Annotated[int, Field(description="Those where a mark stands that passed its check.")]
    refused: Annotated[dict[Refusal, int], Field(description="How many places did not do, by reason.")]


class LabelFacts(Section):
    """The machine-readable label in the file that was made."""

    packet: Annotated[int, Field(description="Number of the XMP packet (KHR_xmp_json_ld) about the whole file.")]
    source_type: Annotated[
        str | None, Field(description="The IPTC's address of how the model came about; null where nobody says so.")
    ]
    aigc: Annotated[
        Literal["written", "filled", "kept"] | None,
        Field(
            description="China's label: written, or that of the file that was sent, with fields of the propagator "
            "filled in or kept as it was; null: none."
        ),
    ]
    height_reached: Annotated[
        float | None,
        Field(
            description="Share of 24 views in which the letters are as high as the label's rule asks for; null without "
            "such a rule, and without marks."
        ),
    ]
    kept: Annotated[
        list[str], Field(description="Properties of the file that was sent that contradict the request; they stay.")
    ]


class WatermarkQuality(Section):
    """Fit, visibility and legibility of the marks; null where not measured. High is good."""

    wps: Annotated[Score, Field(description="Placement by whole faces, a share.")]
    wps_area: Annotated[Score, Field(description="Placement by exact area, a share.")]
    ray: Annotated[Score, Field(description="Visibility from 24 views, from just above the letters, a share.")]
    ray_box: Annotated[Score, Field(description="Visibility from 24 views, from the box's top, a share.")]
    coverage: Annotated[Score, Field(description="Visibility from 200 directions, a share of these.")]
    crop_survival: Annotated[Score, Field(description="Crops that leave a whole mark, a share.")]
    prominence: Annotated[Score, Field(description="Letters' share of the asset's silhouette, mean over 24 views.")]
    prominence_least: Annotated[Score, Field(description="The same in the view that shows the least of them.")]
    label_height_share: Annotated[
        Score, Field(description="Height of the highest letters over the picture's side, mean over 24 views.")
    ]
    match: Annotated[Score, Field(description="Likeness of the marks' relief to their artwork, 0 to 1.")]
    ocr: Annotated[Score, Field(description="Readability: similarity of what is read, 0 to 1, mean over 24 views.")]
    ocr_ge_08: Annotated[Score, Field(alias="ocr_ge_0.8", description="Share of the views that read at 0.8 or more.")]
    ocr_exact: Annotated[Score, Field(description="Share of the views that read exactly.")]


class AssetUtility(Section):
    """The cost of the marks to the asset; null where not measured. Low is good, save of `ss`."""

    smse: Annotated[Score, Field(description="Mean distance to the original, size-30 units.")]
    smse_squared: Annotated[Score, Field(description="Mean squared distance to the original, squared size-30 units.")]
    ipe: Annotated[int | None, Field(description="Change in the number of connected parts.")]
    lce: Annotated[Score, Field(description="Variance of the letters' height in each mark, squared size-30 units.")]
    lce_pooled: Annotated[Score, Field(description="Variance of the letters' height in all marks together, likewise.")]
    se: Annotated[Score, Field(description="Share of the marks on salient ground.")]
    se_lee2005: Annotated[Score, Field(description="The same by the saliency of Lee, Varshney and Jacobs 2005.")]
    ss: Annotated[Score, Field(description="Similarity of pictures before and after, -1 to 1.")]


class ViewFacts(Section):
    """One of the paper's views, and how far the text is read from there."""

    direction: Annotated[Vector, Field(description="From the asset to the camera, a unit vector.")]
    up: Annotated[Vector, Field(description="Upwards in the picture, a unit vector.")]
    ocr: Annotated[float, Field(description="Best ratio of the text to a reading, 0 to 1; `ocr` is the mean.")]


class Metrics(Section):
    """Measurements on the file as it was written."""

    watermark_quality: WatermarkQuality
    asset_utility: AssetUtility
    higher_is_better: Annotated[dict[str, bool], Field(description="Whether high is good, by metric.")]
    units: Annotated[
        dict[str, str],
        Field(description="By metric, of the size-30 frame; others are shares, similarities or counts."),
    ]
    semantics: Annotated[str | None, Field(description="What extracted the features of `ss`; null: nothing did.")]
    views: Annotated[
        list[ViewFacts] | None, Field(description="The paper's 24 views; null where nothing was read.")
    ] = None
    missing: Annotated[dict[str, Notice], Field(description="Why a metric is null, by metric.")]
    seconds: Annotated[dict[str, float], Field(description="How long each group of metrics took.")]


class PreviewModelFacts(FileFacts):
    """The preview model, and its own marks and metrics."""

    alone: Annotated[bool, Field(description="Whether it took the place of the model.")]
    triangles_before: Annotated[int, Field(description="Triangles of the asset, counted as they are drawn.")]
    triangles: Annotated[int, Field(description="Those of them that are left.")]
    faces: Annotated[int, Field(description="Triangles of the file as they are drawn, letters included.")]
    textures: Annotated[list[tuple[int, int]], Field(description="Width and height of each of its images, pixels.")]
    watermarks: Annotated[list[int], Field(description="The marks that it carries, by `id`.")]
    refused: Annotated[
        dict[Refusal, int], Field(description="How many of the model's marks do not fit on it, by reason.")
    ]
    seconds: Annotated[float, Field(description="How long it took to make; the stage `writing` has them too.")]
    metrics: Annotated[
        Metrics | None,
        Field(
            description="Its own, against the file that was sent; null with `evaluate: none`, and where it took the "
            "place of the model, whose `metrics` they are."
        ),
    ] = None


class Report(Section):
    """The marks of an asset, where they are, and their cost to it. Fields are only added to it."""

    schema_: Annotated[
        Literal["meshmark.report/1"], Field(alias="schema", description="Which report this is, and its version.")
    ] = SCHEMA
    asset: Annotated[AssetFacts, Field(description="The file that was sent.")]
    model: Annotated[
        AssetFacts | FileFacts, Field(description="The file that was made; without metrics, nothing of its surface.")
    ]
    export: Annotated[
        ExportFacts | None, Field(description="The same in another format; null where `format` asked for none.")
    ] = None
    parameters: Annotated[Parameters, Field(description="As resolved by the preset.")]
    seed: Annotated[int, Field(description="Of every random draw.")]
    plan: Annotated[
        str | None,
        Field(description="SHA-256 of the plan whose places were taken, hexadecimal; null where they were searched."),
    ] = None
    engine: Engine
    units: Frame
    eye: Eye
    watermarks: Annotated[list[Watermark], Field(description="The marks, by `id`.")]
    copies: Annotated[list[CopyFacts], Field(description="Other copies of the asset in its file.")]
    embossing: Embossing
    label: Annotated[LabelFacts | None, Field(description="Null where no label was asked for.")] = None
    preview_model: Annotated[
        PreviewModelFacts | None, Field(description="Null where none was asked for, or none could be made.")
    ] = None
    metrics: Annotated[Metrics | None, Field(description="Null with `evaluate: none`.")]
    fonts: Annotated[
        list[FontFacts], Field(description="The fonts that the text is set in, in the order of their first letters.")
    ]
    warnings: Annotated[list[Notice], Field(description="What did not go as asked although the job went on.")]
    timings: Annotated[dict[str, float], Field(description="Seconds that each stage took.")]
    memory: Annotated[
        dict[str, int], Field(description="The most resident bytes the process had held by the end of each stage.")
    ]


class Place(BaseModel):
    """Placement of one watermark, in the coordinates of the original: what is read of an entry of ``watermarks``.

    ``up`` and ``normal`` need not be of length one; a ``right`` that is given must agree with them.
    """

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    center: Vector
    up: Vector
    normal: Vector
    size: Annotated[Vector, Field(description="Width and height of the text, depth of its letters; world units.")]
    relief: Annotated[float, Field(description="Height of the letters above the surface, world units.")]
    text: str = ""
    lines: Annotated[list[str], Field(description="The lines that the text is set in; none: as it is.")] = []


class Places(BaseModel):
    """Placements of all watermarks of an asset; a whole report is valid input, too."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    watermarks: list[Place]


class EvaluationReport(Section):
    """The metrics of a pair of files, whoever made them."""

    schema_: Annotated[
        Literal["meshmark.report/1"], Field(alias="schema", description="Which report this is, and its version.")
    ] = SCHEMA
    asset: Annotated[AssetFacts, Field(description="The original.")]
    model: Annotated[AssetFacts, Field(description="The watermarked file.")]
    seed: Annotated[int, Field(description="Of the random samples.")]
    engine: Engine
    units: Frame
    eye: Eye
    watermarks: Annotated[list[Place], Field(description="As given.")]
    warnings: Annotated[list[Notice], Field(description="What was measured otherwise than it could have been.")]
    metrics: Metrics
    timings: Annotated[dict[str, float], Field(description="Seconds.")]
