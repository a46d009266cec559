"""A program that looks for a mark by its box in the report finds its letters there, not the back of a thin wall."""

import numpy as np
import pytest
import trimesh

from core.analysis.facts import SurfaceFacts
from core.analysis.saliency import saliency
from core.choices import Evaluate, Mode
from core.embossing.other_side import hold_other_side
from core.geometry.surface import Surface
from core.parameters import Parameters
from core.pipeline import watermark
from core.placement.context import PlacementContext, build_context
from tests.core.placement.shapes import box, carrier, inside_out, layouts, moved, plane
from tests.core.shapes import join, surface

ABOVE = box((0.0, 0.0, 0.0), (4.0, 0.5, 0.5))


def plate(thickness: float, cells: int = 40) -> Surface:
    """Two sheets of 20 x 20, the upper one at height 0; their rims are left open."""
    return join(plane(20, 20, cells), moved(inside_out(plane(20, 20, cells)), shift=(0, 0, -thickness)))


def context(shape: Surface, mode: Mode = Mode.EMBOSS) -> PlacementContext:
    parameters = Parameters(text="watermark", relief=0.1, mode=mode, count=1).resolved()
    rng = np.random.default_rng(0)
    return build_context(carrier(shape), SurfaceFacts(saliency(shape, 0)), layouts(0.125), parameters, rng)


@pytest.mark.parametrize(("mode", "deep"), [(Mode.EMBOSS, 0.1), (Mode.DEBOSS, 0.2)])
def test_a_wall_is_thin_where_its_other_side_is_less_than_a_relief_behind_the_letters(mode: Mode, deep: float) -> None:
    assert hold_other_side(ABOVE, context(plate(0.8 * deep), mode))[0]
    assert not hold_other_side(ABOVE, context(plate(1.3 * deep), mode))[0]


def test_on_bent_ground_the_other_side_of_a_thicker_wall_is_as_deep_as_the_letters() -> None:
    flat = plate(0.15)
    sag = 0.1 * flat.positions[:, :1] ** 2 - 0.2
    bent = surface(flat.positions + sag * np.array([0.0, 0.0, 1.0]), flat.faces)
    assert not hold_other_side(ABOVE, context(flat))[0]
    assert hold_other_side(ABOVE, context(bent))[0]


def test_a_sheet_and_a_solid_have_no_other_side_there() -> None:
    assert not hold_other_side(ABOVE, context(plane(20, 20, 40)))[0]
    assert not hold_other_side(ABOVE, context(plate(3.0)))[0]


def thin_plate() -> bytes:
    mesh = trimesh.creation.box(extents=(2.0, 2.0, 0.002))
    for _ in range(5):
        mesh = mesh.subdivide()
    data = mesh.export(file_type="glb")
    assert isinstance(data, bytes)
    return data


def test_an_asset_all_of_whose_walls_are_thin_gets_as_many_marks(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Parameters(text="watermark", evaluate=Evaluate.NONE)
    found = watermark(thin_plate(), asked, preview=False).report["watermarks"]
    monkeypatch.setattr("core.embossing.marks.hold_other_side", lambda boxes, *_: np.zeros(len(boxes), dtype=bool))
    assert len(found) == len(watermark(thin_plate(), asked, preview=False).report["watermarks"]) > 1
