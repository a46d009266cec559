"""Our own product as a strategy like the baselines."""

from functools import partial

import numpy as np

from core.choices import Evaluate, Profile, Strength
from core.geometry.boxes import Boxes
from core.gltf.scene import scene_of
from core.lab.baselines.strategy import Marked, Prepared, Strategy
from core.lab.plain import plain
from core.parameters import Parameters
from core.pipeline import run_stages
from core.placement.options import PlacementOptions
from core.report import Report
from core.stages import Request


def meshmark(
    prepared: Prepared, parameters: Parameters, _rng: np.random.Generator, options: PlacementOptions | None = None
) -> Marked:
    """The file watermarked by :func:`core.pipeline.watermark`, read back from the written GLB.

    Its draws come from ``parameters.seed``, as they do for every user; ``options`` are the tuned values of placement,
    those of the preset if None.

    Raises:
        MeshmarkError: as the pipeline.
    """
    unmeasured = parameters.model_copy(update={"evaluate": Evaluate.NONE}).resolved()
    result = run_stages(prepared.data, Request(unmeasured, prepared.font, preview=False, options=options))
    surface = prepared.surface
    marks = Report.model_validate(result.report).watermarks
    boxes = Boxes(
        np.array([mark.center for mark in marks]),
        np.array([[mark.right, mark.up, mark.normal] for mark in marks]),
        np.array([mark.size for mark in marks]),
    ).to_frame(surface.offset, surface.scale)
    relief = np.array([mark.relief for mark in marks]) * surface.scale
    scene = scene_of(result.model)
    return Marked(plain(scene.surface.in_frame_of(surface)), boxes, relief, scene)


def meshmark_flat(prepared: Prepared, parameters: Parameters, rng: np.random.Generator) -> Marked:
    """:func:`meshmark` with letters of the flat profile.

    Raises:
        MeshmarkError: as the pipeline.
    """
    return meshmark(prepared, parameters.model_copy(update={"profile": Profile.FLAT}), rng)


def meshmark_default(
    prepared: Prepared, parameters: Parameters, rng: np.random.Generator, strength: Strength = Strength.STANDARD
) -> Marked:
    """:func:`meshmark` as it is when nothing but a text is asked for, at a ``strength``: of the ``parameters`` only
    text, count and seed are used, so the letters have colours chosen for each mark.

    Raises:
        MeshmarkError: as the pipeline.
    """
    asked = Parameters(text=parameters.text, count=parameters.count, seed=parameters.seed, strength=strength)
    return meshmark(prepared, asked, rng)


meshmark_discreet: Strategy = partial(meshmark_default, strength=Strength.DISCREET)
meshmark_strong: Strategy = partial(meshmark_default, strength=Strength.STRONG)
