import numpy as np
import pytest

from core.errors import ErrorCode, MeshmarkError
from core.lab.attacks.subdivide import subdivide
from core.lab.plain import Mesh
from core.metrics.topology import topology
from tests.core.lab.attacks.settings import area, mesh_of, target_of, volume
from tests.core.placement.shapes import plane, sphere


def test_two_rounds_make_sixteen_faces_of_one_and_leave_the_surface_as_it_was() -> None:
    ball = mesh_of(sphere(3, rings=8))
    fine = subdivide(ball, target_of(ball)).mesh
    assert len(fine.faces) == 16 * len(ball.faces)
    assert area(fine) == pytest.approx(area(ball), rel=1e-12)
    assert volume(fine) == pytest.approx(volume(ball), rel=1e-12)
    assert np.array_equal(fine.positions[: len(ball.positions)], ball.positions)
    assert topology(fine.surface()).watertight


def test_an_open_sheet_keeps_its_rim() -> None:
    sheet = mesh_of(plane(2, 2))
    fine = subdivide(sheet, target_of(sheet), 1).mesh
    assert len(fine.faces) == 8
    assert len(fine.positions) == 9


def test_more_faces_than_an_asset_may_have_are_refused() -> None:
    many = Mesh(np.eye(3), np.tile([[0, 1, 2]], (1_300_000, 1)))
    with pytest.raises(MeshmarkError) as refused:
        subdivide(many, target_of(many), 1)
    assert refused.value.code is ErrorCode.BUDGET_EXCEEDED
    assert "5200000" in refused.value.message
