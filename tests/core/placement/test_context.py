import numpy as np
import pytest
from numpy.typing import NDArray

from core.analysis.facts import SurfaceFacts
from core.analysis.saliency import saliency
from core.errors import ErrorCode, MeshmarkError
from core.geometry.directions import EYE_DISTANCE
from core.geometry.surface import Surface
from core.parameters import Parameters
from core.placement.context import PlacementContext, build_context
from tests.core.placement.shapes import carrier, cuboid, layouts, plane


def opened(shape: Surface, usable: NDArray[np.bool_] | None = None) -> PlacementContext:
    parameters = Parameters(text="watermark").resolved()
    rng = np.random.default_rng(0)
    return build_context(carrier(shape, usable), SurfaceFacts(saliency(shape, 0)), layouts(0.125), parameters, rng)


def test_a_direction_is_faced_as_nearly_as_any_surface_looks_that_way() -> None:
    """From the middle of what looks there: a camera is as near as a viewer."""
    sheet = opened(plane(30, 30))
    cameras = EYE_DISTANCE * sheet.targets.directions
    assert sheet.facing == pytest.approx(cameras[:, 2] / np.linalg.norm(cameras, axis=1), abs=0.02)
    cube = opened(cuboid(30, 30, 30))
    ahead = np.abs(cameras).max(axis=1) - 15
    aside = np.sqrt((cameras**2).sum(axis=1) - (ahead + 15) ** 2)
    assert cube.facing == pytest.approx(ahead / np.hypot(ahead, aside), abs=0.05)


def test_faces_that_are_not_usable_carry_no_box_but_stay_in_the_way() -> None:
    shape = cuboid(30, 30, 30)
    front = shape.normals[:, 2] > 0.5
    context = opened(shape, usable=front)
    assert len(context.ground.faces) == front.sum()
    assert not context.normals[~front].any()
    assert context.carrier.index is not None
    assert context.facing[context.targets.directions[:, 2] < 0].max() < 0


def test_an_asset_without_usable_faces_says_so() -> None:
    shape = cuboid(1, 1, 1)
    with pytest.raises(MeshmarkError) as caught:
        opened(shape, usable=np.zeros(len(shape.faces), dtype=bool))
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert "see-through" in caught.value.message
