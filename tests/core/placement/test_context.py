import numpy as np
import pytest
from numpy.typing import NDArray

from core.analysis.facts import SurfaceFacts
from core.analysis.saliency import saliency
from core.errors import ErrorCode, MeshmarkError
from core.geometry.surface import Surface
from core.parameters import Parameters
from core.placement.context import PlacementContext, build_context
from tests.core.placement.shapes import carrier, cuboid, layouts, plane


def opened(shape: Surface, usable: NDArray[np.bool_] | None = None) -> PlacementContext:
    parameters = Parameters(text="watermark").resolved()
    rng = np.random.default_rng(0)
    return build_context(carrier(shape, usable), SurfaceFacts(saliency(shape, 0)), layouts(0.125), parameters, rng)


def test_a_direction_is_faced_as_nearly_as_any_surface_looks_that_way() -> None:
    sheet = opened(plane(30, 30))
    assert sheet.facing == pytest.approx(sheet.targets.directions[:, 2])
    cube = opened(cuboid(30, 30, 30))
    assert cube.facing == pytest.approx(np.abs(cube.targets.directions).max(axis=1))


def test_faces_that_are_not_usable_carry_no_box_but_stay_in_the_way() -> None:
    shape = cuboid(30, 30, 30)
    front = shape.normals[:, 2] > 0.5
    context = opened(shape, usable=front)
    assert len(context.ground.faces) == front.sum()
    assert not context.normals[~front].any()
    assert context.carrier.index is not None
    assert context.facing == pytest.approx(context.targets.directions[:, 2])


def test_an_asset_without_usable_faces_says_so() -> None:
    shape = cuboid(1, 1, 1)
    with pytest.raises(MeshmarkError) as caught:
        opened(shape, usable=np.zeros(len(shape.faces), dtype=bool))
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert "see-through" in caught.value.message
