from typing import Any

import numpy as np
import pytest

from core.analysis.heads import HEADS, on_head, words
from core.analysis.skinning import skin_deformation
from core.analysis.symmetry import MirrorPlane
from core.arrays import Bool, Float
from core.geometry.sampling import sample
from core.gltf.scene import flatten
from tests.core.gltf.builder import Builder, grid

MIDDLE = MirrorPlane(np.array([1.0, 0.0, 0.0]), 0.0)


@pytest.mark.parametrize(
    ("name", "head"),
    [
        ("mixamorig:Head", True),
        ("mixamorig:HeadTop_End", True),
        ("J_Bip_C_Head", True),
        ("J_Adj_L_FaceEye", True),
        ("Bip001 Head", True),
        ("DEF-jaw", True),
        ("eye.L", True),
        ("LEFTEYE", True),
        ("b_Head_05", True),
        ("頭", True),
        ("左目", True),
        ("RearLeg", False),
        ("mixamorig:LeftForeArm", False),
        ("Mage_Hat", False),
        ("clip_01", False),
        ("Overhead", False),
        ("", False),
    ],
)
def test_bones_of_heads_are_known_by_their_names_in_the_rigs_of_many_programs(name: str, head: bool) -> None:
    assert any(HEADS.fullmatch(word) for word in words(name)) == head


def test_a_name_is_taken_apart_at_signs_digits_and_capitals() -> None:
    assert words("mixamorig:HeadTop_End") == ["mixamorig", "head", "top", "end"]
    assert words("CC_Base_JawRoot02") == ["cc", "base", "jaw", "root"]


def on(names: list[str], plane: MirrorPlane | None = None, skinned: bool = True) -> tuple[Float, Bool | None]:
    """Heights of samples of a standing sheet, 0 to 10, whose lower seven tenths follow the first of two bones and whose
    upper part follows the second, above it, and which of them are on a head. The third name is that of a plate that
    hangs from the second bone."""
    positions, faces = grid(10)
    positions = positions - np.array([5, 0, 0], dtype=np.float32)
    builder = Builder()
    extra: dict[str, Any] = {}
    if skinned:
        upper = positions[:, 1] >= 7
        extra = {
            "JOINTS_0": builder.accessor(np.column_stack([upper, 0 * upper, 0 * upper, 0 * upper]), "<u1"),
            "WEIGHTS_0": builder.accessor(np.tile(np.array([1, 0, 0, 0], np.float32), (len(positions), 1))),
        }
    body = builder.primitive(positions, faces, **extra)
    plate = builder.primitive(positions / 5 + np.array([0, 6, 0], np.float32), faces)
    nodes: list[dict[str, Any]] = [
        {"mesh": 0} | ({"skin": 0} if skinned else {}),
        {"name": names[0], "children": [2]},
        {"name": names[1], "translation": [0, 4, 0], "children": [3]},
        {"name": names[2], "mesh": 1},
    ]
    document = builder.document(
        meshes=[{"primitives": [body]}, {"primitives": [plate]}],
        nodes=nodes,
        scenes=[{"nodes": [0, 1]}],
        **({"skins": [{"joints": [1, 2]}]} if skinned else {}),
    )
    scene = flatten(document)
    points, face = sample(scene.surface, 3000, np.random.default_rng(0))
    skin = skin_deformation(scene, scene.surface, points, face)
    own = scene.surface.face_primitive[face] == 0
    found = on_head(scene, skin, face, plane)
    height = np.where(own, scene.surface.to_world(points)[:, 1], np.nan)
    return height, found


def test_what_follows_the_bone_of_a_head_is_on_it_and_what_hangs_from_it_is_not() -> None:
    height, head = on(["hips", "Head", "hat"])
    assert head is not None
    assert head[height > 11].all()
    assert not head[height < 6].any()
    assert not head[np.isnan(height)].any()


def test_a_part_that_hangs_from_a_bone_and_calls_itself_a_face_is_one() -> None:
    height, head = on(["hips", "Head", "face mask"])
    assert head is not None
    assert head[np.isnan(height)].all()


def test_a_neck_counts_where_no_bone_is_called_a_head() -> None:
    _, head = on(["hips", "Neck1", "hat"])
    assert head is not None
    _, none = on(["hips", "spine", "hat"])
    assert none is None


def test_bones_without_names_have_their_head_where_the_highest_of_them_ends_in_the_middle() -> None:
    beside = MirrorPlane(np.array([1.0, 0.0, 0.0]), 9.0)
    assert on(["", "", ""], plane=beside)[1] is None
    assert on(["", "", ""], plane=None)[1] is None


def test_parts_without_a_skin_are_heads_by_their_names() -> None:
    height, head = on(["body", "neck", "Head"], skinned=False)
    assert head is not None
    assert head[np.isnan(height)].all()
    assert not head[~np.isnan(height)].any()


def test_a_bust_is_not_a_head_all_over() -> None:
    _, head = on(["Head", "jaw", "hat"])
    assert head is None
