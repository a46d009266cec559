"""Pictures of a suspect file from which every pixel can be traced back to the surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.arrays import Float
from core.geometry.directions import EYE_DISTANCE, field_of_view
from core.geometry.products import cross, product
from core.geometry.triangles import unit
from core.rendering.local_height import local_height
from core.rendering.relief import relief
from core.rendering.renderer import Renderer
from core.verify.report import Kind

Picture = NDArray[np.uint8]
Part = tuple[slice, slice]  # rows and columns of a picture

USUAL_RADIUS = 18.0  # size-30 units that relief pictures are made for: nearer ones show smaller folds a pixel
STEP, LOW_RADIUS = 0.08, 4.0  # size-30 units: of pictures of height; below this radius a step is lower in proportion
EVERYTHING: Part = (slice(None), slice(None))


@dataclass(frozen=True, eq=False)
class Look:
    """One look at an asset.

    Attributes:
        ordinary: (S, S, 3) picture as a viewer shows it.
        depth: (S, S) distance along the view axis, size-30 units; 0 in the background.
        center: (3,) that the camera looks at.
        axes: (3, 3) rows right, up, and back to the camera.
        slope: tangent of half the angle of the picture.
        radius: that the picture shows around the ``center``, size-30 units.
        grain: of its picture of height, pixels.
    """

    ordinary: Picture
    depth: NDArray[np.float32]
    center: Float
    axes: Float
    slope: float
    radius: float
    grain: float

    def picture(self, kind: Kind, part: Part = EVERYTHING) -> Picture:
        """(H, W, 3) picture of a ``part`` of what is seen."""
        if kind == "ordinary":
            return self.ordinary[part]
        if kind == "relief":
            return relief(self.depth[part], nearer=self.radius / USUAL_RADIUS)
        return local_height(self.depth[part], self.grain, STEP * min(self.radius / LOW_RADIUS, 1.0))

    def points(self, pixels: Float) -> Float:
        """(N, 3) places on the surface that ``pixels`` (N, 2), to the right and down, show; nan for the background."""
        size = len(self.depth)
        column, row = np.clip(np.floor(pixels), 0, size - 1).astype(np.int64).T
        distance = np.where(self.depth[row, column] > 0, self.depth[row, column], np.nan).astype(np.float64)
        across, along = (2 * pixels / size - 1).T * self.slope
        camera = np.stack([across * distance, -along * distance, EYE_DISTANCE - distance], axis=1)
        return np.asarray(self.center + product(camera, self.axes))


def look(renderer: Renderer, direction: Float, up: Float, grain: float = 1.0) -> Look:
    """A look at the asset that is loaded, in its present frame, from a ``direction`` (3,) with ``up`` (3,) upwards."""
    ordinary, depth, _ = renderer.render_with_depth(direction, up)
    radius, back = renderer.frame.radius, unit(np.asarray(direction, dtype=np.float64)[None])
    right = unit(cross(np.asarray(up, dtype=np.float64)[None], back))
    return Look(
        ordinary=ordinary,
        depth=depth,
        center=np.array(renderer.frame.center),
        axes=np.concatenate([right, cross(back, right), back]),
        slope=float(np.tan(field_of_view(radius) / 2)),
        radius=radius,
        grain=grain,
    )
