"""What every way of watermarking is given and gives back, so that one benchmark can compare them all."""

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
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.geometry.sampling import sample, thin
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.gltf.scene import flatten
from core.lab.baselines.solid import solid
from core.lab.plain import Mesh
from core.parameters import PRESETS, Mode, Parameters, Preset
from core.placement.candidates import upright
from core.placement.finetune import adam, alignment_loss
from core.placement.fit import PAPER_RADIUS, PAPER_SAMPLES

THICKNESS = 0.5  # of the text solid and its box, size-30 units (paper, supplement "Implementation Details")


@dataclass(frozen=True, eq=False)
class Marked:
    """A watermarked asset in the size-30 frame of the original.

    Attributes:
        mesh: the result, without materials.
        boxes: where the marks were put, B of them.
        relief: (B,) how far each mark's letters stand out above the middle of its box, size-30 units.
    """

    mesh: Mesh
    boxes: Boxes
    relief: Float


@dataclass(eq=False)
class Prepared:
    """One asset and one text, with what several strategies and counts share; each part is made when first asked for.

    The shared parts draw from ``seed``, never from a strategy's generator, so that results do not depend on which
    strategy ran first.

    Attributes:
        data: the file.
        surface: as it is in the file; faces that are wound inside out stay so.
        index: over all of ``surface``.
        artwork: of the text.
        seed: of the shared draws.
        font: the font file; None for the bundled one.
    """

    data: bytes
    surface: Surface
    index: SpatialIndex
    artwork: Artwork
    seed: int
    font: bytes | None = None
    _initial: dict[float, tuple[Boxes, Float]] = field(default_factory=dict)
    _fitted: dict[float, tuple[Boxes, Float]] = field(default_factory=dict)

    def initial(self, width: float) -> tuple[Boxes, Float]:
        """The paper's candidates before fine-tuning and their alignment loss (B,): H_s = 300 area samples thinned to
        radius 1."""
        if width not in self._initial:
            points, face = sample(self.surface, PAPER_SAMPLES, np.random.default_rng(self.seed))
            kept = thin(points, PAPER_RADIUS)
            boxes = self.boxes_at(points[kept], face[kept], width)
            self._initial[width] = boxes, alignment_loss(boxes, self.index)
        return self._initial[width]

    def fitted(self, width: float) -> tuple[Boxes, Float]:
        """The same candidates after the paper's Adam, and their alignment loss (B,)."""
        if width not in self._fitted:
            self._fitted[width] = adam(self.initial(width)[0], self.index)
        return self._fitted[width]

    def boxes_at(self, points: Float, face: Int, width: float) -> Boxes:
        """Boxes for text of ``width`` at ``points`` (N, 3) on ``face`` (N,), along the normals of these faces.

        The paper's Algorithm 1 turns the front (0, 0, 1) by angles towards the normal and does not say about which
        axes; here text stays upright. The paper's code loses candidates whose normal is an exact axis to a division
        by zero; these do not.
        """
        size = (width, width * self.artwork.aspect, THICKNESS)
        return Boxes(points, upright(self.surface.normals[face]), np.tile(size, (len(points), 1)))

    @cached_property
    def solid(self) -> Manifold:
        """The asset as whole-mesh booleans need it; raises ``not_manifold``."""
        return solid(self.surface)

    @cached_property
    def saliency(self) -> Saliency:
        """What stands out on the asset."""
        return saliency(self.surface, self.seed)


Strategy = Callable[[Prepared, Parameters, np.random.Generator], Marked]


def prepare(
    data: bytes, text: str, seed: int = 0, font: bytes | None = None, budgets: Budgets = DEFAULT_BUDGETS
) -> Prepared:
    """The content of a file, ready for every strategy.

    Raises:
        MeshmarkError: for everything that keeps the file from being read or the text from being drawn.
    """
    surface = flatten(document_of(admit(data, budgets), budgets)).surface
    return Prepared(data, surface, SpatialIndex(surface.positions, surface.faces), text_artwork(text, font), seed, font)


def text_width(parameters: Parameters) -> float:
    """Width of the text, size-30 units: as asked for, else that of the ``paper`` preset.

    The paper gives a "size (scale of mesh) of 4" of a text-to-3D tool whose own unit it does not say. A fair
    comparison gives every strategy the same ``size``.

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
