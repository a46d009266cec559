"""Meshes as they come: every kind of disorder either carries a whole watermark or is told there is no room."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from core.arrays import Int
from core.choices import Evaluate, Mode
from core.errors import ErrorCode, MeshmarkError
from core.geometry.surface import Surface
from core.gltf.scene import scene_of
from core.parameters import Parameters
from core.pipeline import Result, watermark
from tests.core.gltf.builder import simple
from tests.core.shapes import box, grid, join, moved, sphere, surface

FEW = Parameters(text="watermark", count=3, size=3.0, evaluate=Evaluate.GEOMETRY)
RNG = np.random.default_rng(7)


def _file(shape: Surface, file_type: str = "ply") -> bytes:
    data = trimesh.Trimesh(shape.positions, shape.faces, process=False).export(file_type=file_type)
    return data.encode() if isinstance(data, str) else bytes(data)


def _marked(data: bytes) -> Result:
    result = watermark(data, FEW, preview=False)
    asset, model = result.report["asset"], result.report["model"]
    assert 1 <= len(result.report["watermarks"]) <= 3
    for fact in ("components", "boundary_edges"):
        assert model[fact] == asset[fact], fact
    assert model["nonmanifold_edges"] <= asset["nonmanifold_edges"]
    return result


def _with(shape: Surface, faces: Int) -> Surface:
    return surface(shape.positions, np.concatenate([shape.faces, faces]))


def _turned(shape: Surface, which: NDArray[np.bool_] | slice = slice(None)) -> Surface:
    faces = shape.faces.copy()
    faces[which] = faces[which][:, ::-1]
    return surface(shape.positions, faces)


BALL = sphere(5.0, 4)
BLOCK = box(8.0, 6.0, 4.0)
SLAB = grid(10.0, 6.0, 30, 18)


def _duplicates() -> Surface:
    return _with(BALL, BALL.faces[RNG.permutation(len(BALL.faces))[:800]])


def _double_sided_shell() -> Surface:
    return _with(BALL, BALL.faces[:, ::-1])


def _shuffled_double_sided_shell() -> Surface:
    both = _double_sided_shell()
    return surface(both.positions, both.faces[RNG.permutation(len(both.faces))])


def _double_sided_sheet() -> Surface:
    return _with(SLAB, SLAB.faces[:, ::-1])


def _three_coincident_layers() -> Surface:
    return _with(_with(BALL, BALL.faces[:, ::-1]), BALL.faces[:, [1, 2, 0]])


def _collapsed_faces() -> Surface:
    corner = BALL.faces[:400]
    return _with(BALL, np.concatenate([corner[:, [0, 0, 1]], corner[:, [2, 1, 2]], corner[:, [0, 0, 0]]]))


def _unused_and_collinear() -> Surface:
    """Faces without area whose three corners differ, hung on edges that exist already."""
    middle = (SLAB.positions[SLAB.faces[:60, 0]] + SLAB.positions[SLAB.faces[:60, 1]]) / 2
    number = len(SLAB.positions) + np.arange(60)
    added = np.column_stack([SLAB.faces[:60, 0], number, SLAB.faces[:60, 1]])
    return surface(np.concatenate([SLAB.positions, middle]), np.concatenate([SLAB.faces, added]))


def _closed_collinear() -> Surface:
    """A closed block whose top is split along one edge by a vertex that a face without area ties in."""
    positions = np.concatenate([BLOCK.positions, BLOCK.positions[BLOCK.faces[0, :2]].mean(axis=0)[None]])
    a, b, c = BLOCK.faces[0]
    faces = np.concatenate([BLOCK.faces[1:], [[a, 8, c], [8, b, c], [a, b, 8]]])
    return surface(positions, faces)


def _inside_out() -> Surface:
    return _turned(BALL)


def _inside_out_block() -> Surface:
    return _turned(BLOCK)


def _one_part_inside_out() -> Surface:
    return join(BALL, moved(_turned(BALL), 14.0, 0.0, 0.0))


def _random_winding() -> Surface:
    return _turned(BALL, RNG.random(len(BALL.faces)) < 0.3)


def _half_of_it_turned() -> Surface:
    return _turned(BALL, BALL.positions[BALL.faces].mean(axis=1)[:, 1] > 0)


def _t_junctions() -> Surface:
    """Coarse and fine strips side by side: the fine one's vertices lie in the middle of the coarse one's edges."""
    return join(grid(10.0, 3.0, 10, 3), moved(grid(10.0, 3.0, 17, 5), 0.0, 3.0, 0.0))


def _hundreds_of_parts() -> Surface:
    return join(
        *(
            moved(box(3.0, 1.5, 1.0), 3.5 * x, 2.0 * y, 1.5 * z)
            for x in range(5)
            for y in range(8)
            for z in (0, 1, 2, 3, 4)
        )
    )


def _slivers() -> Surface:
    return grid(10.0, 6.0, 2000, 1)


def _layered() -> Surface:
    return join(*(moved(grid(10.0, 6.0, 6, 4), 0.0, 0.0, 0.002 * layer) for layer in range(30)))


def _everything() -> Surface:
    parts = (
        _duplicates(),
        _double_sided_shell(),
        _inside_out(),
        _random_winding(),
        _collapsed_faces(),
        _t_junctions(),
        _inside_out_block(),
    )
    return join(*(moved(part, 14.0 * number, 0.0, 0.0) for number, part in enumerate(parts)))


MESSES: dict[str, Callable[[], Surface]] = {
    name.removeprefix("_"): build
    for name, build in (
        (build.__name__, build)
        for build in (
            _duplicates,
            _double_sided_shell,
            _shuffled_double_sided_shell,
            _double_sided_sheet,
            _three_coincident_layers,
            _collapsed_faces,
            _unused_and_collinear,
            _closed_collinear,
            _inside_out,
            _inside_out_block,
            _one_part_inside_out,
            _random_winding,
            _half_of_it_turned,
            _t_junctions,
            _hundreds_of_parts,
            _slivers,
            _layered,
            _everything,
        )
    )
}


@pytest.mark.parametrize("file_type", ["glb", "ply", "obj"])
@pytest.mark.parametrize("name", MESSES)
def test_a_messy_mesh_is_marked_without_being_torn(name: str, file_type: str) -> None:
    _marked(_file(MESSES[name](), file_type))


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e4, 1e7])
def test_any_unit_will_do(scale: float) -> None:
    _marked(_file(surface(BALL.positions * scale, BALL.faces), "glb"))


def _far(sizes: float) -> Surface:
    return surface(BALL.positions + np.array([sizes * 10.0, 0.0, 0.0]), BALL.faces)


@pytest.mark.parametrize("sizes", [10.0, 1000.0])
def test_a_model_far_from_the_origin_is_marked(sizes: float) -> None:
    _marked(_file(_far(sizes), "obj"))


def test_a_glb_whose_own_coordinates_are_too_coarse_for_letters_is_told_so_at_once() -> None:
    tried: list[float] = []
    with pytest.raises(MeshmarkError, match="32-bit") as caught:
        watermark(_file(_far(1000.0), "glb"), FEW, preview=False, progress=lambda _, share: tried.append(share))
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert len(tried) < 200  # a job gives up after ten failed cuts for each mark


def test_duplicates_do_not_keep_letters_from_sinking_but_a_second_layer_does() -> None:
    sunken = FEW.model_copy(update={"mode": Mode.DEBOSS, "evaluate": Evaluate.NONE})
    assert watermark(_file(_duplicates()), sunken, preview=False).report["watermarks"]
    with pytest.raises(MeshmarkError, match="another surface lies within reach") as refused:
        watermark(_file(_double_sided_shell()), sunken, preview=False)
    assert "raised letters" in refused.value.remedy, "which it takes, see above"


def _double_sided_glb(shape: Surface) -> bytes:
    document = simple(shape.positions, shape.faces)
    document.json["materials"] = [{"doubleSided": True}]
    document.json["meshes"][0]["primitives"][0]["material"] = 0
    return document.to_glb()


def test_letters_on_a_part_that_is_inside_out_rise_where_they_are_seen() -> None:
    """A GLB keeps its winding; of a format that knows no culling the faces are turned."""
    files = _file(BALL), _file(_inside_out()), _double_sided_glb(_inside_out())
    surfaces = [scene_of(_marked(data).model).surface for data in files]
    furthest = np.linalg.norm(BALL.positions, axis=1).max() * surfaces[0].scale
    for found, sign in zip(surfaces, (1.0, 1.0, -1.0), strict=True):
        radius = np.linalg.norm(found.positions[found.faces].mean(axis=1), axis=1)
        assert radius.max() > furthest * 0.99
        mesh = trimesh.Trimesh(found.positions, found.faces, process=False)
        assert np.sign(mesh.volume) == sign
        plain = sphere(15.0, 4)
        assert abs(mesh.volume) > trimesh.Trimesh(plain.positions, plain.faces, process=False).volume * 0.98


def test_dust_has_no_room() -> None:
    dust = join(*(moved(box(0.05, 0.05, 0.05), *RNG.random(3) * 10) for _ in range(500)))
    with pytest.raises(MeshmarkError) as caught:
        watermark(_file(dust), FEW, preview=False)
    assert caught.value.code is ErrorCode.NO_PLACEMENT


def _coincident_plates() -> bytes:
    """A plate that is there twice, with other triangles the second time; turned, so that both are met by chance."""
    turn = trimesh.transformations.euler_matrix(0.4, 0.9, 0.2)  # type: ignore[no-untyped-call]
    plates = [trimesh.creation.box((2, 1, 2)), trimesh.creation.box((2, 1, 2)).subdivide().subdivide()]
    scene = trimesh.Scene([plate.apply_transform(turn) for plate in plates])
    return bytes(scene.export(file_type="glb"))  # type: ignore[no-untyped-call]


def test_letters_rise_on_all_sides_of_a_plate_that_coincides_with_another() -> None:
    asked = Parameters(text="watermark", count=6, evaluate=Evaluate.NONE)
    report = watermark(_coincident_plates(), asked, preview=False).report
    assert len({tuple(np.round(mark["normal"], 2)) for mark in report["watermarks"]}) == 6


def test_letters_do_not_sink_into_a_plate_that_coincides_with_another_which_would_hide_them() -> None:
    asked = Parameters(text="watermark", count=6, mode=Mode.DEBOSS, evaluate=Evaluate.NONE)
    with pytest.raises(MeshmarkError, match="another surface lies within reach") as caught:
        watermark(_coincident_plates(), asked, preview=False)
    assert caught.value.code is ErrorCode.NO_PLACEMENT
