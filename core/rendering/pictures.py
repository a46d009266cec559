"""The pictures that the visual metrics share: an asset as an ordinary viewer shows it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.arrays import Bool, Float
from core.geometry.directions import view_directions
from core.gltf.scene import Scene
from core.rendering.renderer import Frame, Part, Renderer

PICTURE_SIZE = 1024  # pixels a side; OCR depends on it more than on anything else
MANY = 20_000  # triangles of an asset, from which on single samples are drawn faster than four a pixel
DIRECTIONS, UPS = view_directions()
_, _ONE, _CAMERA = np.unique(np.hstack([DIRECTIONS, UPS]), axis=0, return_index=True, return_inverse=True)
FIRST = _ONE[_CAMERA]  # (24,) the first of the views that show the same

Pictures = NDArray[np.uint8]


class Large(Protocol):
    """Pictures (S, S, 3) sRGB of an asset, by the numbers of its views."""

    def __len__(self) -> int:
        """The number of views."""

    def __getitem__(self, view: int, /) -> Pictures:
        """The picture of one."""


@dataclass(eq=False)
class Drawn:
    """The paper's 24 views of a scene, each drawn when it is asked for, as long as the renderer is open.

    Args:
        scene: it is loaded whenever another one is.
        renderer: S is its size.
        frame: the view.
    """

    scene: Scene
    renderer: Renderer
    frame: Frame
    _kept: dict[int, Pictures] = field(default_factory=dict)  # those that another view shows too

    def __len__(self) -> int:
        """Their number."""
        return len(DIRECTIONS)

    def __getitem__(self, view: int, /) -> Pictures:
        """(S, S, 3) the whole picture of a view."""
        first = int(FIRST[view])
        if first in self._kept:
            return self._kept[first]
        picture = self._draw(first, None)
        if np.count_nonzero(first == FIRST) > 1:
            self._kept[first] = picture
        return picture

    def parts(self, places: Float, side: int) -> dict[int, Pictures]:
        """Squares of ``side`` pixels about ``places`` (24, 2) in the pictures, to the right and down, in shares of
        their sides; by view, none where there is no place."""
        size, drawn = self.renderer.size, dict[int, Pictures]()
        side = min(side, size)
        for view in np.flatnonzero(np.isfinite(places).all(axis=1)).tolist():
            if (first := int(FIRST[view])) not in drawn:
                left, top = np.clip(np.round(places[first] * size) - side // 2, 0, size - side).astype(int).tolist()
                drawn[first] = self._draw(first, Part(size, left, top, side))
            drawn[view] = drawn[first]
        return drawn

    def _draw(self, view: int, part: Part | None) -> Pictures:
        self.renderer.load(self.scene, self.frame)
        return self.renderer.render(DIRECTIONS[view], UPS[view], part)


@dataclass(frozen=True, eq=False)
class Views:
    """Views of an asset, as large as each use needs.

    Attributes:
        compared: (V, N, N, 3) sRGB, to be compared with those of another asset; (0, N, N, 3) where nothing is.
        large: the same views, in which text is looked for.
    """

    compared: Pictures
    large: Large


def views(scene: Scene, renderer: Renderer, frame: Frame | None = None) -> Views:
    """The paper's 24 views of a scene, which stays loaded; ``frame`` is that of :func:`pictures`.

    Those to be compared are half as wide as the renderer's pictures. Features take 128 or 224 pixels of them; from
    pictures drawn as small as that the score differs by up to 0.006, from these by less than 0.001 from that of means
    of pictures twice as wide (33 assets). In the frame of an asset of :data:`MANY` triangles they are means of pictures
    twice as wide with one sample a pixel: in half of the time, and by less than 0.001 as well, but by up to 0.003 on
    assets of a few straight edges.

    Raises:
        MeshmarkError: as :func:`core.rendering.drawables.drawables`.
    """
    renderer.load(scene, frame)
    half = renderer.size // 2
    small = partial(renderer.render, part=Part(half, 0, 0, half))
    draw = renderer.render_half if renderer.frame.triangles >= MANY else small
    compared = np.empty((len(DIRECTIONS), half, half, 3), dtype=np.uint8)
    for picture, rows in _each(draw, DIRECTIONS, UPS):
        compared[rows] = picture
    return Views(compared, Drawn(scene, renderer, renderer.frame))


def pictures(
    scene: Scene, renderer: Renderer, directions: Float = DIRECTIONS, ups: Float = UPS, frame: Frame | None = None
) -> NDArray[np.uint8]:
    """(V, S, S, 3) sRGB pictures of a scene, one for each camera; by default the paper's 24 views.

    A camera that occurs twice, as the front does in the 24 views, is drawn once.

    Args:
        scene: it stays loaded.
        renderer: S is its size.
        directions: (V, 3) from the object to each camera.
        ups: (V, 3) directions that point upwards in each picture.
        frame: the view; None: of the asset.

    Raises:
        MeshmarkError: as :func:`core.rendering.drawables.drawables`.
    """
    renderer.load(scene, frame)
    drawn = np.empty((len(directions), renderer.size, renderer.size, 3), dtype=np.uint8)
    for picture, rows in _each(renderer.render, directions, ups):
        drawn[rows] = picture
    return drawn


def _each(draw: Callable[[Float, Float], Pictures], directions: Float, ups: Float) -> Iterator[tuple[Pictures, Bool]]:
    """Pictures drawn by each different camera, each with the views that show it."""
    cameras, row = np.unique(np.hstack([directions, ups]), axis=0, return_inverse=True)
    for number, camera in enumerate(cameras):
        yield draw(camera[:3], camera[3:]), row == number
