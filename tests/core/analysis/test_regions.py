from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from core.analysis.regions import Regions, regions
from core.budgets import DEFAULT_BUDGETS
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.boxes import Boxes
from core.gltf.scene import Scene, flatten
from core.parameters import parse_parameters
from tests.core.formats.meshes import MESHES
from tests.core.formats.samples import DAE, OBJ_ZIP, STL_BINARY, THREEMF
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder

CRATE, LID, WHEEL = (np.arange(36) // 12 == number for number in range(3))


@cache
def crates() -> Scene:
    """A wooden crate with a steel lid below it in the hierarchy, 4 to its right, and a nameless wooden wheel at 8."""
    builder = Builder()
    primitives = [builder.primitive(CUBE, CUBE_FACES) | {"material": material} for material in (0, 1, 0)]
    return flatten(
        builder.document(
            meshes=[{"primitives": [primitive], "name": f"mesh {n}"} for n, primitive in enumerate(primitives)],
            materials=[{"name": "Wood"}, {"name": "Steel"}, {"name": "Unused"}],
            nodes=[
                {"name": "Crate", "mesh": 0, "children": [1]},
                {"name": "Lid", "mesh": 1, "translation": [4, 0, 0]},
                {"mesh": 2, "translation": [8, 0, 0]},
                {"name": "Empty"},
            ],
            scenes=[{"nodes": [0, 2, 3]}],
        )
    )


def scene_of(data: bytes) -> Scene:
    return flatten(document_of(admit(data, DEFAULT_BUDGETS), DEFAULT_BUDGETS))


def found(scene: Scene, **asked: list[dict[str, Any]]) -> Regions:
    return regions(scene, scene.surface, parse_parameters({"text": "a"} | asked))


def refusal(scene: Scene, **asked: list[dict[str, Any]]) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        found(scene, **asked)
    assert caught.value.code is ErrorCode.UNKNOWN_REGION
    return caught.value


def box(*corners: float) -> dict[str, Any]:
    return {"box": {"min": corners[:3], "max": corners[3:]}}


def marks(scene: Scene, *centers: list[float], size: float = 0.5) -> Boxes:
    """Upright cubes at places in the world, with an edge length in the world."""
    surface = scene.surface
    middle = (np.array(centers) - surface.offset) * surface.scale
    return Boxes(middle, np.tile(np.eye(3), (len(middle), 1, 1)), np.full((len(middle), 3), size * surface.scale))


def test_without_regions_everything_is_allowed_and_nothing_preferred() -> None:
    nothing = found(crates())
    assert nothing.allowed.all()
    assert not nothing.preferred.any()
    assert not nothing.touches(marks(crates(), [0, 0, 0])).any()


@pytest.mark.parametrize(
    ("region", "faces"),
    [
        ({"node": "Lid"}, LID),
        ({"node": "Crate"}, CRATE | LID),
        ({"node": "mesh 2"}, WHEEL),
        ({"material": "Wood"}, CRATE | WHEEL),
        ({"material": "Steel"}, LID),
        (box(2.9, -2, -2, 5.1, 2, 2), LID),
    ],
    ids=["node", "node and what is below it", "mesh of a nameless node", "material", "other material", "box"],
)
def test_a_region_means_these_faces(region: dict[str, Any], faces: NDArray[np.bool_]) -> None:
    assert (found(crates(), keep_out=[region]).allowed == ~faces).all()
    assert (found(crates(), prefer=[region]).preferred == faces).all()


def test_regions_add_up() -> None:
    assert (found(crates(), keep_out=[{"node": "Lid"}, {"node": "mesh 2"}]).allowed == CRATE).all()


def test_what_is_kept_out_is_not_preferred() -> None:
    both = found(crates(), keep_out=[{"node": "Lid"}], prefer=[{"node": "Crate"}])
    assert (both.preferred == CRATE).all()


def test_all_nodes_of_one_name_are_meant_and_all_instances() -> None:
    builder = Builder()
    offsets = builder.accessor([[0, 0, 0], [0, 4, 0], [0, 8, 0]])
    instances = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": offsets}}}
    scene = flatten(
        builder.document(
            meshes=[{"primitives": [builder.primitive(CUBE, CUBE_FACES)]}],
            nodes=[
                {"name": "Bolt", "mesh": 0},
                {"name": "Nut", "mesh": 0, "translation": [4, 0, 0]},
                {"name": "Bolt", "mesh": 0, "translation": [8, 0, 0], "extensions": instances},
            ],
            scenes=[{"nodes": [0, 1, 2]}],
            extensionsUsed=["EXT_mesh_gpu_instancing"],
        )
    )
    assert (np.flatnonzero(found(scene, keep_out=[{"node": "Bolt"}]).allowed) // 12 == 1).all()
    assert found(scene, prefer=[{"node": "Bolt"}]).preferred.sum() == 4 * 12


def test_a_bone_stands_for_what_it_and_the_bones_below_it_move() -> None:
    """Four corners of a cube follow the upper bone, four each of its two children by halves."""
    builder = Builder()
    upper = np.array(CUBE)[:, 1] > 0
    joints = np.where(upper[:, None], [0, 0, 0, 0], [1, 2, 0, 0])
    weights = np.where(upper[:, None], [1.0, 0, 0, 0], [0.4, 0.3, 0.3, 0])
    cube = builder.primitive(
        CUBE, CUBE_FACES, JOINTS_0=builder.accessor(joints, "u1"), WEIGHTS_0=builder.accessor(weights)
    )
    scene = flatten(
        builder.document(
            meshes=[{"primitives": [cube]}],
            nodes=[
                {"name": "Body", "mesh": 0, "skin": 0},
                {"name": "Spine", "children": [2]},
                {"name": "Tail", "children": [3]},
                {"name": "Tip"},
                {"name": "Idle"},
            ],
            skins=[{"joints": [1, 2, 3, 4]}],
            scenes=[{"nodes": [0, 1, 4]}],
        )
    )
    lower = ~upper[np.array(CUBE_FACES).reshape(-1, 3)].all(axis=1)
    assert (found(scene, prefer=[{"node": "Tail"}]).preferred == lower).all()
    assert found(scene, prefer=[{"node": "Spine"}]).preferred.all()
    error = refusal(scene, keep_out=[{"node": "Idle"}])
    assert error.remedy == 'Its nodes are "Body", "Spine".'


def test_a_face_that_is_only_partly_in_a_box_stays_allowed_but_marks_in_the_box_do_not() -> None:
    """A crate of twelve faces: a box around one corner of it holds none of them whole."""
    scene = crates()
    corner = found(scene, keep_out=[box(0.4, 0.4, 0.4, 2, 2, 2)])
    assert corner.allowed.all()
    places = marks(scene, [0.7, 0.7, 1], [0.3, 0.3, 1], [0, 0, 1], [-0.7, -0.7, 1])
    assert corner.touches(places).tolist() == [True, True, False, False]
    assert corner.touches(places, margin=0.2 * scene.surface.scale).tolist() == [True, True, True, False]


def test_a_mark_that_is_turned_towards_a_box_reaches_further() -> None:
    scene = crates()
    kept = found(scene, keep_out=[box(0.3, -2, -2, 2, 2, 2)])
    straight = marks(scene, [0, 0, 1])
    turn = np.array([[[1, 1, 0], [-1, 1, 0], [0, 0, np.sqrt(2)]]]) / np.sqrt(2)
    assert not kept.touches(straight).any()
    assert kept.touches(Boxes(straight.center, turn, straight.size)).all()


def test_points_are_preferred_by_their_face_or_by_a_box_around_them() -> None:
    scene = crates()
    asked = found(scene, prefer=[{"node": "Lid"}, box(0, -2, -2, 2, 2, 2)])
    on_crate, on_lid = np.flatnonzero(CRATE)[0], np.flatnonzero(LID)[0]
    points = (
        np.array([[[0.5, 0, 1], [-0.5, 0, 1], [-0.5, 0, 1], [4, 0, 1]]]) - scene.surface.offset
    ) * scene.surface.scale
    assert asked.preference(points, np.array([[on_crate, on_crate, -1, on_lid]])).tolist() == [0.5]


def test_a_box_is_in_the_coordinates_of_the_asset_not_in_the_size_30_frame() -> None:
    surface = crates().surface
    corners = found(crates(), prefer=[box(-1, -1, -1, 1, 1, 1)]).boxes_in
    assert corners.shape == (1, 2, 3)
    np.testing.assert_allclose(surface.to_world(corners[0]), [[-1, -1, -1], [1, 1, 1]])


@pytest.mark.parametrize(
    ("region", "named", "listed"),
    [
        ({"node": "lid"}, '"lid"', 'Its nodes are "Lid", "Crate", "mesh 2".'),
        ({"node": "Empty"}, '"Empty"', 'Its nodes are "Crate", "Lid", "mesh 2".'),
        ({"node": "mesh 0"}, '"mesh 0"', 'Its nodes are "mesh 2", "Crate", "Lid".'),
        ({"material": "Unused"}, '"Unused"', 'Its materials are "Wood", "Steel".'),
        ({"material": "Lid\n"}, r'"Lid\n"', 'Its materials are "Wood", "Steel".'),
        (box(1.5, -1, -1, 2.5, 1, 1), "(1.5, -1, -1) to (2.5, 1, 1)", "between (-1, -1, -1) and (9, 1, 1)"),
        (box(1e300, 0, 0, 1e308, 1, 1), "(1e+300, 0, 0)", "between (-1, -1, -1) and (9, 1, 1)"),
    ],
)
def test_what_is_nowhere_is_refused_with_what_there_is(region: dict[str, Any], named: str, listed: str) -> None:
    assert refusal(crates(), keep_out=[region]).message.startswith("`keep_out[0]`: no triangle of this asset")
    error = refusal(crates(), keep_out=[{"node": "Lid"}], prefer=[{"node": "Lid"}, region])
    assert error.message.startswith("`prefer[1]`: ")
    assert named in error.message
    assert listed in error.remedy


def test_of_many_names_the_ten_most_similar_are_listed() -> None:
    builder = Builder()
    nodes = [{"name": f"part {n}", "mesh": 0, "translation": [3 * n, 0, 0]} for n in range(50)]
    nodes[40]["name"] = "Windscreen"
    nodes[41]["name"] = "x" * 300
    scene = flatten(
        builder.document(
            meshes=[{"primitives": [builder.primitive(CUBE, CUBE_FACES)]}],
            nodes=nodes,
            scenes=[{"nodes": list(range(50))}],
        )
    )
    error = refusal(scene, keep_out=[{"node": "Windshield"}])
    assert error.remedy.startswith('Its nodes are "Windscreen", "part 0", ')
    assert error.remedy.endswith('"part 8" and 39 more.')


def test_an_asset_without_names_says_so() -> None:
    builder = Builder()
    scene = flatten(builder.document(meshes=[{"primitives": [builder.primitive(CUBE, CUBE_FACES)]}]))
    assert refusal(scene, keep_out=[{"node": "Head"}]).remedy == "No node of this asset has a name; give a box instead."


def test_keeping_everything_out_leaves_no_place() -> None:
    kept = found(crates(), keep_out=[{"material": "Wood"}])
    assert (kept.within(CRATE | LID) == LID).all()
    with pytest.raises(
        MeshmarkError, match="`keep_out` leaves no place for a watermark: it takes all 24 faces"
    ) as caught:
        kept.within(CRATE | WHEEL)
    assert caught.value.code is ErrorCode.NO_PLACEMENT


def test_where_nothing_was_usable_anyway_keep_out_is_not_blamed() -> None:
    assert not found(crates(), keep_out=[{"node": "Lid"}]).within(np.zeros(36, dtype=bool)).any()


@pytest.mark.parametrize(
    ("data", "region", "faces"),
    [
        (OBJ_ZIP, {"material": "paint"}, 8),
        (OBJ_ZIP, box(-1, -1, -1, 1, 1, 1), 12),
        (STL_BINARY, box(-1, -1, -1, 1, 1, 1), 12),
        (THREEMF, {"node": "cube"}, 12),
        (THREEMF, box(-0.0011, -0.0011, -0.0011, 0.0011, 0.0011, 0.0011), 12),
        (DAE, {"node": "cube"}, 12),
    ],
    ids=["OBJ material", "OBJ box", "STL box", "3MF object", "3MF box in metres", "DAE geometry"],
)
def test_names_and_boxes_of_other_formats_are_those_of_the_resulting_glb(
    data: bytes, region: dict[str, Any], faces: int
) -> None:
    assert found(scene_of(data), prefer=[region]).preferred.sum() == faces


# What of each real asset a name means: a node, a node with nodes below it, a bone, a material.
REAL = {
    "truck-yellow-kenney.glb": [({"node": "wheel-back-left"}, 92), ({"node": "body"}, 601)],
    "mage-kaykit.glb": [({"node": "Mage_Head"}, 1027), ({"node": "head"}, 1423), ({"node": "Mage_Hat"}, 396)],
    "fox.glb": [({"node": "b_Head_05"}, 86)],
    "cesium-milk-truck.glb": [({"node": "Wheels"}, 1536), ({"material": "glass"}, 56)],
}


@pytest.mark.parametrize("name", [name for name in REAL if (MESHES / name).exists()])
def test_names_in_real_assets_mean_their_parts(name: str) -> None:
    scene = scene_of((MESHES / name).read_bytes())
    for region, faces in REAL[name]:
        assert (~found(scene, keep_out=[region]).allowed).sum() == faces
