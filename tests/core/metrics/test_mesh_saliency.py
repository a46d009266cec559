import numpy as np
import trimesh

from core.metrics.mesh_saliency import mesh_saliency
from core.metrics.se import se
from tests.core.placement.shapes import box, boxes, cuboid, inside_out, join, moved, plane, sphere, surface

KNOB = join(cuboid(10, 10, 10), moved(sphere(0.3), shift=(0, 0, 5)))


def test_a_knob_on_a_plate_is_salient_and_the_plate_is_not() -> None:
    found = mesh_saliency(KNOB, seed=0)
    away = np.linalg.norm(found.points - [0, 0, 5], axis=1)
    inner = (np.abs(found.points) < 3).sum(axis=1) == 2  # on the faces of the block, well within their edges
    assert found.salient[away < 0.3].mean() > 0.9
    assert found.salient[(away > 2) & inner].mean() < 0.01


def test_a_mark_over_the_knob_is_an_error_and_one_beside_it_is_none() -> None:
    marks = boxes(box((0, 0, 5.2), (0.8, 0.8, 0.8)), box((0, 3, 5), (4, 1, 0.4)))
    error, mean = se(mesh_saliency(KNOB, seed=0), marks)
    assert error == 0.5
    assert mean[1] < 0.05 < mean[0]


def test_the_edges_of_a_block_stand_out_alike_whether_its_faces_are_two_triangles_or_many() -> None:
    coarse = cuboid(10, 10, 10)
    positions, faces = coarse.positions, coarse.faces
    for _ in range(5):
        positions, faces = trimesh.remesh.subdivide(positions, faces)  # type: ignore[no-untyped-call]
    maps = [mesh_saliency(shape, seed=0) for shape in (coarse, surface(positions, faces))]
    for found in maps:
        edge = (np.abs(found.points) > 4.9).sum(axis=1) >= 2
        face = (np.abs(found.points) < 3).sum(axis=1) == 2
        assert found.value[edge].mean() > 5 * found.value[face].mean()


def test_it_does_not_matter_which_way_faces_are_wound() -> None:
    outwards, inwards = mesh_saliency(KNOB, seed=0), mesh_saliency(inside_out(KNOB), seed=0)
    around = [np.linalg.norm(found.points - [0, 0, 5], axis=1) < 0.3 for found in (outwards, inwards)]
    shares = [found.salient[here].mean() for found, here in zip((outwards, inwards), around, strict=True)]
    assert shares == [1, 1]


def test_on_a_plane_nothing_is_salient() -> None:
    found = mesh_saliency(plane(10, 10, cells=5), seed=0)
    assert not found.salient.any()
    assert not found.value.any()


def test_the_same_seed_gives_the_same_map() -> None:
    one, other = (mesh_saliency(KNOB, seed=3) for _ in range(2))
    assert np.array_equal(one.value, other.value)
    assert one.threshold == other.threshold
