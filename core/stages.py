"""The frozen records that the stages of a run take and give."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from core.arrays import Float
from core.artwork.artwork import FaceUse
from core.budgets import DEFAULT_BUDGETS, Budgets
from core.embossing.mesh import WorkingMesh
from core.errors import MeshmarkError
from core.formats.format import Format, OutputFile
from core.gltf.scene import Scene
from core.gltf.tint import Coloring, Tints
from core.labels.write import WrittenLabel
from core.notices import Notice
from core.parameters import Parameters
from core.plan import Plan

if TYPE_CHECKING:
    from core.analysis.analyse import SurfaceAnalysis
    from core.analysis.facts import Carrier, SurfaceFacts
    from core.artwork.layouts import Layouts
    from core.embossing.copies import MarkedCopy
    from core.embossing.emboss import Mark
    from core.embossing.islands import Letters
    from core.embossing.refusal import Refusal
    from core.placement.context import PlacementContext
    from core.placement.objective import Placement
    from core.placement.options import PlacementOptions
    from core.placement.watch import Watch
    from core.rendering.pictures import Views

Publish = Callable[[str, bytes], None]


@dataclass(frozen=True)
class Request:
    """The wishes for one run.

    Attributes:
        parameters: resolved.
        font: a TrueType or OpenType file; None for the bundled one.
        logo: an SVG file, if there is a logo.
        budgets: the most that the asset may declare before it is read.
        preview: render a contact sheet.
        options: the tuned values of placement, for ablations; None for those of the preset.
        watch: somebody who is told of every box of placement; None for nobody.
        plan: of an earlier run for this file, whose places are taken; None to search for places.
        copies: other texts that the places should have room for.
    """

    parameters: Parameters
    font: bytes | None = None
    logo: bytes | None = None
    budgets: Budgets = DEFAULT_BUDGETS
    preview: bool = True
    options: "PlacementOptions | None" = None
    watch: "Watch | None" = None
    plan: Plan | None = None
    copies: tuple[str, ...] = ()


@dataclass
class Run:
    """A run under way: the only state that its stages change.

    Attributes:
        request: the wishes.
        progress: called with the share of the present stage that is done, 0 to 1.
        publish: called with the name of each result ("model", "plan", "preview_model", "export", "report",
            "explanation", "layers", "preview", "turntable", "poster") and its bytes as soon as it exists.
        notices: losses and doubts so far.
        timings: seconds by stage.
        memory: the most resident bytes the process had held up to the end of each stage.
        faces: the typefaces of the text.
    """

    request: Request
    progress: Callable[[float], None]
    publish: Publish
    notices: list[Notice] = field(default_factory=list)
    timings: dict[str, float] = field(default_factory=dict)
    memory: dict[str, int] = field(default_factory=dict)
    faces: tuple[FaceUse, ...] = ()


@dataclass(frozen=True, eq=False)
class Asset:
    """An asset that was read.

    Attributes:
        data: the file.
        format: of the file.
        scene: its nodes in one surface.
        analysis: the surface as it is seen from outside.
        notices: losses and doubts of reading it.
    """

    data: bytes
    format: Format
    scene: Scene
    analysis: "SurfaceAnalysis"
    notices: tuple[Notice, ...] = ()

    @cached_property
    def tints(self) -> Tints:
        """The tints of letters on it, each looked for once."""
        return Tints(self.scene.document, self.scene.texture)


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground of marks, however their places were chosen.

    Attributes:
        carrier: the surface, and the faces that marks may stand on.
        layouts: of the text.
        opaque: least opaque share of a face under letters.
        facts: about the surface; None where places were not searched for.
    """

    carrier: "Carrier"
    layouts: "Layouts"
    opaque: float
    facts: "SurfaceFacts | None" = None


@dataclass(frozen=True, eq=False)
class Candidates:
    """The boxes that may carry the text.

    Attributes:
        context: of the search.
        placement: the boxes, with a good choice among them.
        opaque: least opaque share of a face under letters.
        rng: of placement, for further searches.
    """

    context: "PlacementContext"
    placement: "Placement"
    opaque: float
    rng: np.random.Generator

    @property
    def ground(self) -> Ground:
        """The ground that was searched."""
        return Ground(self.context.carrier, self.context.layouts, self.opaque, self.context.facts)


@dataclass(frozen=True, eq=False)
class Embossed:
    """The marks in the surface.

    Attributes:
        mesh: the surface with the marks.
        letters: of the text, in each layout.
        placement: the candidate boxes.
        marks: by the number of the box in ``placement``.
        refusals: reasons of refused boxes, by their numbers in ``placement``.
    """

    mesh: WorkingMesh
    letters: "Letters"
    placement: "Placement"
    marks: "dict[int, Mark]"
    refusals: "dict[int, Refusal]"


@dataclass(frozen=True, eq=False)
class Exported:
    """The watermarked model in another format, beside its GLB.

    Attributes:
        file: in that format.
        unit, up: of its coordinates and their upward axis; None where they are the input's own, which says neither.
        left_out: contents of the GLB that it does not have, in words.
    """

    file: OutputFile
    unit: str | None
    up: str | None
    left_out: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Output:
    """The watermarked model.

    Attributes:
        embossed: the marks that it shows; None where only a label was asked for.
        coloring: how each of them has the colour of its letters; None for that of the surface.
        copies: the other scenes, levels of detail and unused meshes of the file.
        scene: the marked asset, read back from the bytes of its GLB.
        file: ``scene`` as it is published.
        label: the machine-readable one in it; None where none was asked for.
        heights: (24,) of the highest letters in the paper's views, over the picture's side; None where no label's rule
            asks for a height.
        exported: ``scene`` in another format, where one was asked for.
    """

    embossed: Embossed | None
    coloring: list[Coloring | None]
    copies: "list[MarkedCopy]"
    scene: Scene
    file: OutputFile
    label: WrittenLabel | None = None
    heights: Float | None = None
    exported: Exported | None = None


@dataclass(frozen=True, eq=False)
class LightOutput:
    """The watermarked preview model.

    Attributes:
        output: as of the model itself; its marks are those of the model that fit on fewer triangles.
        before: triangles of the asset, as they are drawn.
        triangles: of them that are left; ``output`` has those of the letters besides.
        textures: (width, height) of its images.
        lacking: the boxes of the model's marks that it does not carry, by their numbers, each with the reason.
        seconds: that it took to make.
    """

    output: Output
    before: int
    triangles: int
    textures: list[tuple[int, int]]
    lacking: "dict[int, Refusal]"
    seconds: float


@dataclass(frozen=True, eq=False)
class Pictures:
    """Renderings.

    Attributes:
        preview: a PNG contact sheet, or None.
        turntable, poster: an animated WebP and its first frame, or None.
        views: of the original and of the result; the reason where there are none; None where none are needed.
        light: of the preview model; None where none are needed, or could be drawn.
    """

    preview: bytes | None = None
    turntable: bytes | None = None
    poster: bytes | None = None
    views: "tuple[Views, Views] | MeshmarkError | None" = None
    light: "Views | None" = None
