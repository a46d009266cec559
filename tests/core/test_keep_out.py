"""Regions from the request to the letters: nothing new in what is kept out, most of it in what is preferred."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from core.analysis.regions import regions
from core.arrays import Float
from core.errors import ErrorCode, MeshmarkError
from core.geometry.surface import Surface
from core.gltf.scene import scene_of
from core.named_regions import NodeRegion
from core.parameters import Parameters, parse_parameters
from core.pipeline import Result, watermark
from tests.core.formats.meshes import MESHES
from tests.core.gltf.builder import CUBE, CUBE_FACES, Builder

SPOT = (Path(__file__).parents[1] / "data" / "spot.glb").read_bytes()
# Spot looks along -z; its head begins at the shoulders.
HEAD = {"box": {"min": [-1, 0.2, -1.5], "max": [1, 1.5, -0.3]}}
CORNER = {"box": {"min": [-0.2, -0.2, -2], "max": [2, 2, 2]}}


@cache
def crate() -> bytes:
    """A crate of twelve faces, from -1 to 1 on each axis."""
    cube = Builder()
    return cube.document(meshes=[{"primitives": [cube.primitive(CUBE, CUBE_FACES)]}]).to_glb()


@cache
def crates() -> bytes:
    """Two crates of twelve faces each, one of wood and one of steel, a bit apart."""
    builder = Builder()
    primitives = [builder.primitive(CUBE, CUBE_FACES) | {"material": material} for material in (0, 1)]
    return builder.document(
        meshes=[{"primitives": [primitive]} for primitive in primitives],
        materials=[{"name": "Wood"}, {"name": "Steel"}],
        nodes=[{"name": "Left", "mesh": 0}, {"name": "Right", "mesh": 1, "translation": [3, 0, 0]}],
        scenes=[{"nodes": [0, 1]}],
    ).to_glb()


def marked(data: bytes, **asked: Any) -> Result:
    return watermark(data, parse_parameters({"text": "watermark", "evaluate": "none"} | asked), preview=False)


def centers(result: Result) -> Float:
    return np.array([mark["center"] for mark in result.report["watermarks"]])


def inside(points: Float, region: dict[str, Any]) -> NDArray[np.bool_]:
    low, high = np.array(region["box"]["min"]), np.array(region["box"]["max"])
    return np.asarray(np.all((points >= low) & (points <= high), axis=1))


def drawn(surface: Surface) -> Float:
    """(N, 3) distinct corners of all triangles, world."""
    return surface.to_world(np.unique(surface.positions[surface.faces].reshape(-1, 3), axis=0))


def added(before: bytes, after: bytes) -> Float:
    """(N, 3) points of the marked asset that are none of the original's, world."""
    old, new = (drawn(scene_of(data).surface) for data in (before, after))
    known = {tuple(point) for point in np.round(old, 5)}
    return new[[tuple(point) not in known for point in np.round(new, 5)]]


@pytest.mark.parametrize("mode", ["emboss", "deboss"])
def test_no_letter_reaches_into_a_box_around_the_head(mode: str) -> None:
    result = marked(SPOT, mode=mode, keep_out=[HEAD])
    assert len(result.report["watermarks"]) >= 4
    assert not inside(centers(result), HEAD).any()
    assert not inside(added(SPOT, result.model), HEAD).any()


@pytest.mark.parametrize("profile", ["flat", "soft"])
def test_a_large_face_that_is_partly_kept_out_carries_letters_on_its_rest(profile: str) -> None:
    result = marked(crate(), keep_out=[CORNER], profile=profile)
    new = added(crate(), result.model)
    assert not inside(new, CORNER).any()
    # Both large faces that look along z reach into the box; the free part of them is used.
    assert {1.0, -1.0} <= set(np.round(new[:, 2], 3))


def test_deep_letters_beside_a_box_do_not_reach_into_it() -> None:
    result = marked(SPOT, keep_out=[HEAD], size=3, relief=1.5)
    assert not inside(added(SPOT, result.model), HEAD).any()


@pytest.mark.parametrize("region", [{"node": "Left"}, {"material": "Wood"}])
def test_a_part_that_is_kept_out_stays_as_it_was(region: dict[str, str]) -> None:
    result = marked(crates(), keep_out=[region])
    assert (added(crates(), result.model)[:, 0] > 1.5).all()


@pytest.mark.parametrize(
    "region", [{"node": "Left"}, {"material": "Wood"}, {"box": {"min": [-2] * 3, "max": [2, 2, 2]}}]
)
def test_a_part_that_is_preferred_gets_more_of_the_marks(region: dict[str, Any]) -> None:
    plain, asked = (centers(marked(crates(), count=6, **more))[:, 0] < 1.5 for more in ({}, {"prefer": [region]}))
    assert asked.mean() > plain.mean()
    assert asked.mean() > 0.6


def test_keep_out_wins_over_prefer() -> None:
    result = marked(SPOT, keep_out=[HEAD], prefer=[HEAD])
    assert not inside(centers(result), HEAD).any()


def test_where_keep_out_leaves_nothing_the_request_is_refused_and_says_why() -> None:
    with pytest.raises(MeshmarkError, match="`keep_out` leaves no place") as caught:
        marked(crates(), keep_out=[{"material": "Wood"}, {"node": "Right"}])
    assert caught.value.code is ErrorCode.NO_PLACEMENT


def test_where_boxes_leave_only_edges_the_refusal_names_keep_out() -> None:
    """No face of a crate lies in these boxes as a whole, but hardly a text has room beside them."""
    most = [
        {"box": {"min": [-0.95, -2, -2], "max": [0.95, 2, 2]}},
        {"box": {"min": [-2, -0.95, -2], "max": [2, 0.95, 2]}},
    ]
    with pytest.raises(MeshmarkError, match="because it reaches into a `keep_out` region") as caught:
        marked(crate(), size=5.5, size_exact=True, keep_out=most)
    assert caught.value.code is ErrorCode.NO_PLACEMENT


def test_a_name_that_does_not_exist_is_refused_with_those_that_do() -> None:
    with pytest.raises(MeshmarkError) as caught:
        marked(crates(), keep_out=[{"node": "Lefd"}])
    assert caught.value.code is ErrorCode.UNKNOWN_REGION
    assert caught.value.remedy == 'Its nodes are "Left", "Right".'


def test_the_report_repeats_the_regions() -> None:
    asked = marked(SPOT, count=1, size=3, keep_out=[HEAD]).report["parameters"]
    assert asked["keep_out"] == [HEAD]
    assert asked["prefer"] == []


# Parts that carry marks when they are not kept out: a node, and a bone with a skin and a hat.
PARTS = {"truck-yellow-kenney.glb": "body", "mage-kaykit.glb": "head"}


def part(data: bytes, name: str) -> set[tuple[float, ...]]:
    """The triangles of a node or bone, world."""
    scene = scene_of(data)
    faces = scene.surface.faces[
        regions(scene, scene.surface, Parameters(text="a", prefer=[NodeRegion(node=name)])).preferred
    ]
    return {
        tuple(corners) for corners in np.round(scene.surface.to_world(scene.surface.positions[faces]).reshape(-1, 9), 4)
    }


@pytest.mark.parametrize("name", [name for name in PARTS if (MESHES / name).exists()])
def test_parts_of_real_assets_are_kept_free(name: str) -> None:
    data = (MESHES / name).read_bytes()
    result = marked(data, count=4, keep_out=[{"node": PARTS[name]}])
    assert part(result.model, PARTS[name]) == part(data, PARTS[name])
