"""Visibility as it is measured, against what pictures show: marks are drawn in colours of their own and counted."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from core.analysis.analyse import eye_index
from core.arrays import Float, Int
from core.choices import Evaluate, Profile
from core.evaluate import to_boxes
from core.geometry.boxes import Boxes
from core.geometry.directions import fibonacci_directions, view_directions
from core.geometry.spatial import SpatialIndex
from core.geometry.surface import Surface
from core.gltf.scene import scene_of
from core.metrics.ray_origins import above_letters
from core.parameters import Parameters
from core.pipeline import watermark
from core.placement.selection import visibility
from core.rendering.renderer import Frame, Renderer
from core.report import Places
from tests.core.rendering.glb import GlbWriter, plain

SPOT = Path(__file__).parents[2] / "data" / "spot.glb"
SIZE = 768
THERE = 0.9  # of the pixels of a mark's letters
STEP = 8  # between the shades of two marks
SPECK = 0.01  # size-30 units
RAISED = {Profile.FLAT: 0.9, Profile.SOFT: 0.6}  # of the relief: tops of letters; soft ones are round
FEWEST = 20  # pixels of letters that can be counted


def agreement(original: bytes, watermarked: bytes, places: Places, raised: float) -> tuple[float, int]:
    """Share of the pairs of a mark and a camera, those that count as seen, in which the letters are in the picture; and
    the number of these pairs."""
    first, second = scene_of(original), scene_of(watermarked)
    surface, index = eye_index(first, first.surface)
    written, written_index = eye_index(second, first.surface)
    boxes, relief = to_boxes(places.watermarks, first.surface)
    turns, even = view_directions()[0], fibonacci_directions(200)
    directions = np.concatenate([turns, even[::3]])
    seen = visibility(boxes, above_letters(surface, index, boxes, relief), written_index, directions)
    mark = letters(index, written, boxes, raised * relief)
    ups = np.where(np.abs(directions[:, 1:2]) > 0.9, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    used = written.positions[np.unique(written.faces)]
    frame = Frame((0.0, 0.0, 0.0), float(np.linalg.norm(used, axis=1).max()))
    with Renderer(SIZE) as renderer:
        renderer.load(scene_of(colored(written, mark)), frame)
        together = np.stack([counts(renderer.render(*view), len(boxes)) for view in zip(directions, ups, strict=True)])
        alone = np.zeros_like(together)
        for number in range(len(boxes)):
            renderer.load(scene_of(colored(written, mark, number)), frame)
            for view in np.flatnonzero(seen[number]):
                alone[view, number] = counts(renderer.render(directions[view], ups[view]), len(boxes))[number]
    pairs = seen.T & (alone >= FEWEST)
    return float((together >= THERE * alone)[pairs].mean()), int(pairs.sum())


def letters(original: SpatialIndex, written: Surface, boxes: Boxes, high: Float) -> Int:
    """(F,) the mark whose letters' tops, further than ``high`` (B,) from the original, each face of the watermarked
    surface belongs to; -1: none."""
    centers = written.positions[written.faces].mean(axis=1)
    mark = np.full(len(centers), -1)
    for number, height in enumerate(high):
        local = (centers - boxes.center[number]) @ boxes.axes[number].T
        inside = np.flatnonzero((np.abs(local) <= boxes.size[number] / 2 + height).all(axis=1))
        ahead = written.normals[inside] @ boxes.axes[number, 2] > 0.5
        raised = original.closest(centers[inside])[0] > height
        mark[inside[raised & ahead]] = number
    return mark


def colored(surface: Surface, mark: Int, only: int | None = None) -> bytes:
    """The surface unlit, each mark's letters in its own colour, all else black; or nothing but the letters of one, and
    a speck in two corners of the surface's bounds, so that it is in the same frame."""
    drawn = np.ones(len(mark), dtype=bool) if only is None else mark == only
    triangles = surface.positions[surface.faces[drawn]]
    ends = surface.positions[np.unique(surface.faces)]
    low, high = ends.min(axis=0), ends.max(axis=0)
    specks = np.stack([low + SPECK * np.eye(3), high - SPECK * np.eye(3)])
    shade = np.append(np.where(mark[drawn] >= 0, 255 - STEP * mark[drawn], 0), [0, 0])
    color = np.stack([shade, *np.zeros((2, len(shade))), np.full(len(shade), 255)], axis=1).astype(np.uint8)
    corners = np.concatenate([triangles, specks]).reshape(-1, 3).astype(np.float32)
    unlit = plain((1, 1, 1, 1), extensions={"KHR_materials_unlit": {}}, doubleSided=True)
    faces = np.arange(len(corners)).reshape(-1, 3)
    return GlbWriter().mesh(corners, faces, {"COLOR_0": np.repeat(color, 3, axis=0)}, unlit).bytes()


def counts(picture: NDArray[np.uint8], marks: int) -> Int:
    """(marks,) pixels of each mark's colour, as sRGB shows it."""
    shades = np.round(255 * ((255 - STEP * np.arange(marks)) / 255) ** (1 / 2.2)).astype(int)
    own = picture[(picture[..., 1:] == 0).all(axis=2), 0]
    return np.asarray(np.bincount(own, minlength=256)[shades])


@pytest.mark.parametrize("profile", Profile)
def test_a_mark_that_counts_as_seen_has_its_letters_in_the_picture(profile: Profile) -> None:
    original = SPOT.read_bytes()
    result = watermark(original, Parameters(text="watermark", color="none", profile=profile, evaluate=Evaluate.NONE))
    share, pairs = agreement(original, result.model, Places.model_validate(result.report), RAISED[profile])
    assert pairs > 100
    assert share >= 0.98
