"""Common input and result of all ways of watermarking, so that one benchmark can compare them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from manifold3d import Manifold

from core.analysis.saliency import Saliency, saliency
from core.arrays import Float, Int
from core.artwork.artwork import Artwork
from core.artwork.outline import text_artwork
from core.budgets import DEFAULT_BUDGETS, Budgets
from core.choices import Mode, Preset
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.geometry.sampling import sample, thin
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.gltf.scene import Scene, flatten
from core.lab.baselines.solid import solid
from core.lab.plain import Mesh
from core.parameters import PRESETS, Parameters
from core.placement.candidates import PAPER_CANDIDATES, upright
from core.placement.finetune import adam, alignment_loss

THICKNESS = PAPER_CANDIDATES.thinnest  # size-30 units, of the text solid and its box


@dataclass(frozen=True, eq=False)
class Marked:
    """A watermarked asset in the size-30 frame of the original.

    Attributes:
        mesh: the result, without materials.
        boxes: of the B marks.
        relief: (B,) height of each mark's letters above the middle of its box, size-30 units.
        delivered: the file that a user gets, in its own materials; None where there is only the mesh.
    """

    mesh: Mesh
    boxes: Boxes
    relief: Float
    delivered: Scene | None = None


@dataclass(eq=False)
class Prepared:
    """One asset and one text, with the parts that several strategies and counts share; each is made at its first use.

    The shared parts draw from ``seed``, never from a strategy's generator, so that results do not depend on the order
    of strategies.

    Attributes:
        data: the file.
        surface: as it is in the file; faces that are wound inside out stay so.
        index: over all of ``surface``.
        artwork: of the text.
        seed: of the shared draws.
        font: the font file; None for the bundled one.
        textured: the file has textures.
        double_sided: the file's materials show the backs of most of its faces.
    """

    data: bytes
    surface: Surface
    index: SpatialIndex
    artwork: Artwork
    seed: int
    font: bytes | None = None
    textured: bool = False
    double_sided: bool = True
    _initial: dict[float, tuple[Boxes, Float]] = field(default_factory=dict)
    _fitted: dict[float, tuple[Boxes, Float]] = field(default_factory=dict)

    def initial(self, width: float) -> tuple[Boxes, Float]:
        """The paper's candidates before fine-tuning and their alignment loss (B,): H_s = 300 area samples thinned to
        radius 1."""
        if width not in self._initial:
            points, face = sample(self.surface, PAPER_CANDIDATES.samples, np.random.default_rng(self.seed))
            assert PAPER_CANDIDATES.radius is not None
            kept = thin(points, PAPER_CANDIDATES.radius)
            boxes = self.boxes_at(points[kept], face[kept], width)
            self._initial[width] = boxes, alignment_loss(boxes, self.index)
        return self._initial[width]

    def fitted(self, width: float) -> tuple[Boxes, Float]:
        """The candidates of :meth:`initial` after the paper's Adam, and their alignment loss (B,)."""
        if width not in self._fitted:
            self._fitted[width] = adam(self.initial(width)[0], self.index)
        return self._fitted[width]

    def boxes_at(self, points: Float, face: Int, width: float) -> Boxes:
        """Boxes for text of ``width`` at ``points`` (N, 3) on ``face`` (N,), along the normals of these faces.

        The paper's Algorithm 1 rotates the front (0, 0, 1) by angles towards the normal and leaves the axes open; here
        text stays upright. The paper's code loses candidates whose normal is an exact axis to a division by zero; here
        they are kept.
        """
        size = (width, width * self.artwork.aspect, THICKNESS)
        return Boxes(points, upright(self.surface.normals[face]), np.tile(size, (len(points), 1)))

    @cached_property
    def solid(self) -> Manifold:
        """The asset as a solid for whole-mesh booleans; raises ``not_manifold``."""
        return solid(self.surface)

    @cached_property
    def saliency(self) -> Saliency:
        """The saliency map of the asset."""
        return saliency(self.surface, self.seed)


Strategy = Callable[[Prepared, Parameters, np.random.Generator], Marked]


def prepare(
    data: bytes, text: str, seed: int = 0, font: bytes | None = None, budgets: Budgets = DEFAULT_BUDGETS
) -> Prepared:
    """The content of a file, ready for every strategy.

    Raises:
        MeshmarkError: where the file cannot be read or the text cannot be drawn.
    """
    scene = flatten(document_of(admit(data, budgets), budgets))
    surface, artwork = scene.surface, text_artwork(text, font)
    index = SpatialIndex(surface.positions, surface.faces)
    materials = [drawn.primitive.material for drawn in scene.primitives]
    textured = any(material.texture is not None for material in materials)
    backs = np.array([material.double_sided for material in materials])[surface.face_primitive]
    double_sided = bool(2 * surface.areas[backs].sum() >= surface.areas.sum())
    return Prepared(data, surface, index, artwork, seed, font, textured, double_sided)


def text_width(parameters: Parameters) -> float:
    """Width of the text, size-30 units: the requested one, else that of the ``paper`` preset.

    The paper gives a "size (scale of mesh) of 4" of a text-to-3D tool without that tool's unit. A fair comparison gives
    every strategy the same ``size``.

    Raises:
        MeshmarkError: ``invalid_parameters`` for sunken letters, which whole-mesh baselines do not make.
    """
    if parameters.mode is not Mode.EMBOSS:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            "This method makes raised letters only.",
            'Ask for the mode "emboss", or compare sunken letters without it.',
        )
    paper: dict[str, Any] = PRESETS[Preset.PAPER]
    return parameters.size if parameters.size is not None else float(paper["size"])
