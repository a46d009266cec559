"""Colours of letters without a material of their own."""

from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from core.gltf.colored_by import ColoredBy
from core.gltf.colors import cielab, hex_linear
from core.gltf.document import Document
from core.gltf.edit import Kind, Style
from core.gltf.scene import Scene, flatten, scene_of
from core.gltf.tint import NEAR, Coloring, Tints
from core.gltf.write import write
from tests.core.gltf.builder import QUAD, QUAD_FACES, Builder
from tests.core.gltf.edited import UV, colors_of_corners, primitives_of, values
from tests.core.gltf.edits import centroid_split
from tests.validator import error_counts

RED = "#d02020"
GREEN, SKY, STEEL = (20, 160, 40), (120, 190, 255), (230, 230, 230)
levels = st.floats(0, 1)
hexadecimal = st.integers(0, 0xFFFFFF).map("#{:06x}".format)


def square(material: dict[str, Any], images: tuple[NDArray[np.uint8], ...] = (), **attributes: Any) -> Scene:
    """A square of one material, whose textures are ``images``."""
    builder = Builder()
    added = {
        name: builder.accessor(rows, dtype, **({"normalized": True} if dtype != "<f4" else {}))
        for name, (rows, dtype) in attributes.items()
    }
    primitive = builder.primitive(QUAD, QUAD_FACES, **added) | {"material": 0}
    textures: dict[str, Any] = {}
    if images:
        views = [builder.view(png(image)) for image in images]
        textures["images"] = [{"bufferView": view, "mimeType": "image/png"} for view in views]
        textures["textures"] = [{"source": number} for number in range(len(images))]
    names = [name for name in ("KHR_texture_transform", *material.get("extensions", {})) if name in str(material)]
    used = {"extensionsUsed": sorted(set(names))} if names else {}
    return flatten(builder.document(meshes=[{"primitives": [primitive]}], materials=[material], **textures, **used))


def png(pixels: NDArray[np.uint8]) -> bytes:
    out = BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()


def halves(left: tuple[int, int, int], right: tuple[int, int, int]) -> NDArray[np.uint8]:
    """An image of two colours side by side, with a noisy seam between them."""
    pixels = np.empty((64, 64, 3), dtype=np.uint8)
    pixels[:, :32], pixels[:, 32:] = left, right
    pixels[:, 24:40] = np.random.default_rng(0).integers(0, 256, (64, 16, 3))
    return pixels


def textured(*images: NDArray[np.uint8], uv: ArrayLike = UV, **more: Any) -> Scene:
    base = {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0}
    material = {"pbrMetallicRoughness": base | more.pop("base", {})} | more
    return square(material, images, TEXCOORD_0=(uv, "<f4"))


def marked(scene: Scene, color: str, glows: bool = False) -> Scene:
    """The square with its first half as letters of a colour."""
    glb = write(scene, centroid_split(scene, [0], [Kind.CAP]), [Style(color, glows)])
    assert not error_counts(glb)
    return scene_of(glb)


def split(before: Scene, after: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a viewer shows at the corners of letters (three faces), and of the ground (one), before and after."""
    shown, ground = colors_of_corners(after), colors_of_corners(before)[1]
    kept = next(number for number, corners in enumerate(shown) if np.allclose(corners, ground, atol=2e-5))
    return np.delete(shown, kept, axis=0).reshape(-1, 3), shown[kept]


def apart(shown: NDArray[np.float64], color: str) -> float:
    """The largest CIELAB distance from a colour."""
    return float(np.linalg.norm(cielab(shown) - cielab(hex_linear(color)[None]), axis=1).max())


def way(scene: Scene, color: str = RED, glows: bool = False) -> Coloring:
    edit = centroid_split(scene, [0], [Kind.CAP])
    [found] = Tints(scene.document).of_marks(scene, edit, [Style(color, glows)])
    assert found is not None
    return found


def materials(scene: Scene) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = scene.document.json["materials"]
    return found


def test_letters_without_a_texture_have_vertex_colours_in_the_primitive_that_they_stand_on() -> None:
    before = square({"name": "clay", "pbrMetallicRoughness": {"metallicFactor": 0.0}})
    after = marked(before, RED)
    assert len(primitives_of(after.document)) == 1
    assert materials(after) == materials(before)
    letters, ground = split(before, after)
    assert apart(letters, RED) < 1
    assert (ground == 1).all(), "as white as before"
    assert way(before).colored_by is ColoredBy.VERTEX_COLORS


def test_on_a_dark_material_its_factor_goes_into_the_vertices_and_the_ground_looks_as_before() -> None:
    base = {"baseColorFactor": [0.02, 0.03, 0.1, 1.0], "metallicFactor": 0.0}
    before = square({"name": "ink", "pbrMetallicRoughness": base})
    after = marked(before, "#f8f8f8")
    letters, ground = split(before, after)
    assert apart(letters, "#f8f8f8") < 1
    np.testing.assert_allclose(ground, np.tile([0.02, 0.03, 0.1], (3, 1)), atol=1e-5)
    assert materials(after)[0] == materials(before)[0], "others may use it"
    assert materials(after)[1]["name"] == "ink"
    assert primitives_of(after.document)[0]["material"] == 1


@pytest.mark.parametrize("dtype", ["u1", "<u2", "<f4"])
@pytest.mark.parametrize("factor", [1.0, 0.2])
def test_vertex_colours_of_the_asset_stay_on_its_ground(dtype: str, factor: float) -> None:
    most = 1.0 if dtype == "<f4" else np.iinfo(dtype).max
    colors = np.round(np.array([[1, 0, 0], [0, 1, 0], [0.2, 0.2, 1], [1, 1, 0]]) * most, 3)
    base = {"baseColorFactor": [factor, factor, factor, 1.0], "metallicFactor": 0.0}
    before = square({"pbrMetallicRoughness": base}, COLOR_0=(colors, dtype))
    after = marked(before, "#f0c0ff")
    letters, _ = split(before, after)
    assert apart(letters, "#f0c0ff") < 2
    assert len(primitives_of(after.document)) == 1


def test_letters_on_a_texture_lie_on_an_even_patch_of_it() -> None:
    before = textured(halves(GREEN, STEEL))
    after = marked(before, RED)
    letters, _ = split(before, after)
    assert apart(letters, RED) < 1
    assert len(primitives_of(after.document)) == 1
    uv = np.unique(values(after.document, "TEXCOORD_0"), axis=0)
    [pinned] = [row for row in uv if not any(np.allclose(row, corner) for corner in UV)]
    assert 40 / 64 < pinned[0] < 1, "on the bright half, away from the seam"
    assert way(before).colored_by is ColoredBy.TEXEL


def test_the_patch_that_is_nearest_to_the_colour_is_taken_among_those_that_reach_it() -> None:
    after = marked(textured(halves(SKY, STEEL)), "#78a0d0")
    pinned = values(after.document, "TEXCOORD_0")
    assert any(0 < u < 24 / 64 for u in pinned[:, 0])
    assert not any(40 / 64 < u < 1 for u in pinned[:, 0])


def test_the_transform_of_a_texture_is_undone() -> None:
    moved = {"KHR_texture_transform": {"scale": [0.5, -2.0], "rotation": 0.7, "offset": [0.3, 0.1]}}
    before = textured(halves(GREEN, STEEL), base={"baseColorTexture": {"index": 0, "extensions": moved}})
    letters, _ = split(before, marked(before, RED))
    assert apart(letters, RED) < 1


@pytest.mark.parametrize(
    "pixels",
    [
        np.random.default_rng(1).integers(0, 256, (64, 64, 3)).astype(np.uint8),
        halves(GREEN, (0, 0, 60)),
    ],
    ids=["nothing even", "nothing bright enough"],
)
def test_on_a_texture_that_cannot_show_the_colour_letters_have_a_material(pixels: NDArray[np.uint8]) -> None:
    before = textured(pixels)
    after = marked(before, RED)
    assert way(before) == Coloring(ColoredBy.MATERIAL, 0.0)
    assert len(primitives_of(after.document)) == 2


def test_metal_bumps_and_shadow_of_the_other_maps_are_avoided() -> None:
    """Four patches of one colour; in each of three maps another of them is bad."""
    white = np.full((64, 64, 3), 255, dtype=np.uint8)
    metal, normal, shadow = white.copy(), np.full_like(white, (128, 128, 255)), white.copy()
    metal[:, :, 1], metal[:, :, 2] = 0, 0  # smooth, and no metal
    metal[:32, :32, 2] = 255
    normal[:32, 32:] = (220, 128, 200)
    shadow[32:, :32] = 20
    before = textured(
        white,
        metal,
        normal,
        shadow,
        base={"metallicFactor": 1.0, "metallicRoughnessTexture": {"index": 1}},
        normalTexture={"index": 2},
        occlusionTexture={"index": 3},
    )
    after = marked(before, RED)
    uv = values(after.document, "TEXCOORD_0")
    corner = (uv > 0.5).all(axis=1) & (uv < 1).all(axis=1)
    assert corner.any(), "the one that is good in all"
    assert len(primitives_of(after.document)) == 1


@pytest.mark.parametrize(
    "material",
    [
        {"emissiveFactor": [0.2, 0.2, 0.2]},
        {"alphaMode": "BLEND"},
        {"alphaMode": "MASK"},
        {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.9}}},
        {"pbrMetallicRoughness": {"roughnessFactor": 0.1}},
    ],
    ids=["emission", "blended", "cut out", "glass", "mirror"],
)
def test_where_more_than_the_base_colour_is_seen_letters_have_a_material(material: dict[str, Any]) -> None:
    scene = square(material)
    assert way(scene).colored_by is ColoredBy.MATERIAL
    assert len(primitives_of(marked(scene, RED).document)) == 2


def test_a_factor_that_an_animation_may_change_stays_where_it_is() -> None:
    base = {"baseColorFactor": [0.02, 0.02, 0.02, 1.0], "metallicFactor": 0.0}
    scene = square({"pbrMetallicRoughness": base})
    scene.document.json["extensionsUsed"] = ["KHR_animation_pointer"]
    assert way(scene).colored_by is ColoredBy.MATERIAL
    assert way(scene, "#101010").colored_by is ColoredBy.VERTEX_COLORS


@pytest.mark.parametrize(
    "wrong",
    [
        {"normalTexture": {"index": 7}},
        {"occlusionTexture": {"index": [0]}},
        {"normalTexture": {"index": 0, "texCoord": "none"}},
        {"base": {"roughnessFactor": "smooth"}},
        {"base": {"baseColorFactor": [2.0, 2.0, 2.0, 1.0]}},
    ],
    ids=["no such texture", "no number", "no set", "no factor", "brighter than white"],
)
def test_a_material_that_is_wrong_where_nothing_else_reads_it_is_left_alone(wrong: dict[str, Any]) -> None:
    scene = textured(halves(GREEN, STEEL), **wrong)
    assert way(scene).colored_by is ColoredBy.MATERIAL


def test_letters_that_glow_have_a_material() -> None:
    assert way(square({}), RED, glows=True).colored_by is ColoredBy.MATERIAL


def test_primitives_that_share_vertices_keep_their_own_colours() -> None:
    """Two halves of a square, one of a dark material: only its vertices take the factor."""
    builder = Builder()
    first = builder.primitive(QUAD, QUAD_FACES[:3]) | {"material": 0}
    second = {"attributes": first["attributes"], "indices": builder.accessor(QUAD_FACES[3:], "<u2"), "material": 1}
    plain = [
        {"pbrMetallicRoughness": {"baseColorFactor": [level, level, level, 1.0], "metallicFactor": 0.0}}
        for level in (0.05, 0.9)
    ]
    document: Document = builder.document(meshes=[{"primitives": [first, second]}], materials=plain)
    before = flatten(document)
    after = marked(before, "#f8f8f8")
    shown = colors_of_corners(after)
    assert apart(shown[:3].reshape(-1, 3), "#f8f8f8") < 1
    np.testing.assert_allclose(shown[3], 0.9, atol=1e-6)


@given(st.tuples(levels, levels, levels), hexadecimal)
def test_a_viewer_shows_the_colour_that_was_asked_for_on_any_ground(
    factor: tuple[float, float, float], color: str
) -> None:
    before = square({"pbrMetallicRoughness": {"baseColorFactor": [*factor, 1.0], "metallicFactor": 0.0}})
    tint = Tints(before.document).of(before.primitives[0].primitive, Style(color))
    assert tint is not None
    after = scene_of(write(before, centroid_split(before, [0], [Kind.CAP]), [Style(color)]))
    shown, ground = colors_of_corners(after), np.array(factor)
    is_ground = (np.abs(shown - ground) < 2e-5).all(axis=(1, 2))
    assert is_ground.any()
    assert tint.error <= NEAR
    assert is_ground.all() or apart(shown[~is_ground].reshape(-1, 3), color) <= tint.error + 0.1
