"""The relief of marks against the artwork that they show."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from core.arrays import Float
from core.artwork.artwork import Artwork
from core.artwork.layouts import Layouts
from core.artwork.outline import text_artwork
from core.artwork.raster import raster
from core.choices import Evaluate
from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.metrics.match import match
from core.parameters import Parameters
from core.pipeline import watermark
from tests.core.placement.shapes import box, rotation

RELIEF = 0.05
TEXT = text_artwork("watermark")
OTHER = text_artwork("Elizabeth")


def mirrored(artwork: Artwork) -> Artwork:
    return replace(artwork, rings=tuple((ring * [-1, 1])[::-1] for ring in artwork.rings))


def stretched(artwork: Artwork, aspect: float) -> Artwork:
    """The artwork with another height."""
    return replace(artwork, rings=tuple(ring * [1, aspect / artwork.aspect] for ring in artwork.rings), aspect=aspect)


def ground(x: Float, y: Float, bend: float) -> Float:
    """A saddle with a slope."""
    return bend * (x**2 - 2 * y**2) + 0.1 * x


def carved(artwork: Artwork, relief: float, bend: float = 0.0) -> SpatialIndex:
    """A height field, the artwork 4 wide in its middle."""
    columns, margin = 600, 60
    ink = np.pad(raster(artwork, columns).astype(float), margin)
    step = 4 / columns
    x, y = ((np.arange(n) - (n - 1) / 2) * step for n in ink.shape[::-1])
    across, up = np.meshgrid(x, y)
    points = np.stack([across, up, ground(across, up, bend) + relief * ink], axis=2).reshape(-1, 3)
    rows, wide = ink.shape
    corner = (np.arange(rows - 1)[:, None] * wide + np.arange(wide - 1)).ravel()
    faces = [(corner, corner + 1, corner + wide + 1), (corner, corner + wide + 1, corner + wide)]
    return SpatialIndex(points, np.concatenate([np.stack(each, axis=1) for each in faces]))


def place(artwork: Artwork) -> Boxes:
    return box(size=(4, 4 * artwork.aspect, 1))


def likeness(index: SpatialIndex, artwork: Artwork = TEXT) -> float:
    (found,) = match(place(artwork), np.array([RELIEF]), Layouts((artwork,)), index)
    return float(found)


@pytest.mark.parametrize("relief", [RELIEF, -RELIEF])
@pytest.mark.parametrize("bend", [0.0, 0.03])
def test_a_faithful_mark_matches_raised_or_sunken_on_flat_and_on_curved_ground(relief: float, bend: float) -> None:
    assert likeness(carved(TEXT, relief, bend)) > 0.94


@pytest.mark.parametrize("bend", [0.0, 0.03])
def test_a_surface_without_a_mark_does_not_match(bend: float) -> None:
    assert likeness(carved(TEXT, 0.0, bend)) < 0.1


def test_nothing_under_the_box_does_not_match() -> None:
    far = SpatialIndex(np.eye(3) + 50, np.array([[0, 1, 2]]))
    assert likeness(far) == 0


def test_mirrored_text_does_not_match() -> None:
    assert likeness(carved(mirrored(TEXT), RELIEF)) < 0.2


def test_text_upside_down_does_not_match() -> None:
    upside_down = replace(TEXT, rings=tuple(-ring for ring in TEXT.rings))
    assert likeness(carved(upside_down, RELIEF)) < 0.3


def test_another_text_in_the_same_font_matches_little() -> None:
    assert likeness(carved(stretched(OTHER, TEXT.aspect), RELIEF)) < 0.35


def test_half_of_a_mark_matches_less_than_a_whole_one_and_more_than_none() -> None:
    whole = carved(TEXT, RELIEF)
    left = whole.positions.copy()
    left[left[:, 0] > 0, 2] = ground(left[:, 0], left[:, 1], 0.0)[left[:, 0] > 0]
    assert 0.5 < likeness(SpatialIndex(left, whole.faces)) < 0.85


def test_each_mark_is_compared_with_the_layout_it_is_set_in() -> None:
    two = text_artwork("water\nmark")
    for artwork in (TEXT, two):
        (found,) = match(place(artwork), np.array([RELIEF]), Layouts((TEXT, two)), carved(artwork, RELIEF))
        assert found > 0.94


def test_where_the_mark_stands_and_how_it_is_turned_does_not_matter() -> None:
    index, turn, shift = carved(TEXT, RELIEF), rotation((1, 2, 3), 100), np.array([3.0, -2.0, 8.0])
    turned = SpatialIndex(index.positions @ turn.T + shift, index.faces)
    one = place(TEXT)
    there = Boxes(one.center + shift, one.axes @ turn.T, one.size)
    (found,) = match(there, np.array([RELIEF]), Layouts((TEXT,)), turned)
    assert found == pytest.approx(likeness(index), abs=0.01)


def test_a_layer_above_the_box_is_not_looked_at() -> None:
    index = carved(TEXT, RELIEF)
    roof = np.array([[-9.0, -9, 3], [9, -9, 3], [0, 9, 3]])
    points, faces = (
        np.concatenate([index.positions, roof]),
        np.concatenate([index.faces, [np.arange(3) + len(index.positions)]]),
    )
    assert likeness(SpatialIndex(points, faces)) > 0.94


def test_no_marks_give_no_likeness() -> None:
    assert match(Boxes.empty(), np.empty(0), Layouts((TEXT,)), carved(TEXT, RELIEF)).shape == (0,)


@pytest.mark.parametrize("text", ["watermark", "水印", "ab\ncd"])
def test_the_report_of_a_marked_plate_has_the_match(text: str) -> None:
    plate = trimesh.creation.box(extents=(30, 14, 2)).export(file_type="glb")
    asked = Parameters(text=text, count=2, evaluate=Evaluate.GEOMETRY)
    report = watermark(plate, asked, preview=False).report
    assert report["metrics"]["watermark_quality"]["match"] > 0.9
    assert report["metrics"]["higher_is_better"]["match"]


def test_a_raster_has_the_artworks_ink_and_its_first_row_at_the_bottom() -> None:
    shape = text_artwork("L")
    picture = raster(shape, 400)
    assert picture.mean() == pytest.approx(shape.ink, abs=0.01)
    assert picture[5].all()
    assert not picture[-5].all()
    assert picture.shape == (round(400 * shape.aspect), 400)
