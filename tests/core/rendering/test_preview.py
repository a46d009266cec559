import os
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from manifold3d import CrossSection, Manifold
from PIL import Image

from core.artwork.outline import text_artwork
from core.errors import ErrorCode, MeshmarkError
from core.gltf.scene import scene_of
from core.rendering.cavity import cavity
from core.rendering.preview import COLUMNS, GAP, VIEWS, contact_sheet
from core.rendering.renderer import Renderer
from tests.core.rendering.glb import CORNERS, CUBE_FACES, GlbWriter, cube, plain

MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", Path(__file__).parents[4] / "shared" / "meshes"))
REAL = [MESHES / name for name in ("fox.glb", "egyptian-cat.glb", "mage-kaykit.glb", "truck-yellow-kenney.glb")]


def sheet(glb: bytes, size: int) -> bytes:
    with Renderer(size) as renderer:
        renderer.load(scene_of(glb))
        return contact_sheet(renderer)


def test_the_sheet_is_a_png_of_eight_tiles_that_all_show_the_asset() -> None:
    image = Image.open(BytesIO(sheet(cube((1, 0, 0, 1)), 128)))
    assert image.format == "PNG"
    assert image.size == (4 * 64 + 3 * GAP, 2 * 64 + GAP)
    pixels = np.asarray(image.convert("RGB"))
    tiles = []
    for index in range(len(VIEWS)):
        row, column = (number * (64 + GAP) for number in divmod(index, COLUMNS))
        tiles.append(pixels[row : row + 64, column : column + 64])
        assert tiles[-1][32, 32, 0] > 2 * tiles[-1][32, 32, 1]


def test_each_tile_shows_its_side() -> None:
    """Six coloured faces, each a primitive of its own: the tiles show front, right, back, left; top and bottom."""
    colors = {5: (1, 0, 0), 1: (0, 1, 0), 4: (0, 0, 1), 0: (1, 1, 0), 3: (0, 1, 1), 2: (1, 0, 1)}
    writer = GlbWriter()
    for side, color in colors.items():
        writer.mesh(CORNERS, CUBE_FACES[2 * side : 2 * side + 2], material=plain((*color, 1.0)))
    pixels = np.asarray(Image.open(BytesIO(sheet(writer.bytes(), 128))).convert("RGB"))
    middles = [pixels[row * (64 + GAP) + 32, column * (64 + GAP) + 32] for row in (0, 1) for column in range(COLUMNS)]
    seen = [tuple(int(channel > 60) for channel in middle) for middle in middles]
    assert [seen[tile] for tile in (0, 1, 2, 3, 6, 7)] == list(colors.values())


def test_letters_without_a_colour_of_their_own_can_be_seen_from_straight_ahead() -> None:
    word = CrossSection([ring * 10 for ring in text_artwork("watermark").rings])
    solid = Manifold.cube((12, 12, 2), True) + word.extrude(0.6).translate((0, 0, 0.622))  # 0.22 above the front
    mesh = solid.to_mesh()
    glb = GlbWriter().mesh(mesh.vert_properties[:, :3], mesh.tri_verts, material=plain((0.6, 0.6, 0.6, 1))).bytes()
    with Renderer(256) as renderer:
        renderer.load(scene_of(glb))
        picture, depth, shaded = renderer.render_with_depth((0, 0, 1), (0, 1, 0))
    letters = np.s_[112:144, 60:196]
    assert cavity(picture, depth, shaded)[letters].std() > 2 * picture[letters].std()


def test_the_sheet_is_the_same_each_time() -> None:
    assert sheet(cube(), 96) == sheet(cube(), 96)


def test_a_broken_file_is_refused_with_the_code_of_its_reader() -> None:
    with pytest.raises(MeshmarkError) as caught:
        sheet(cube()[:-20], 64)
    assert caught.value.code == ErrorCode.TRUNCATED_FILE


@pytest.mark.parametrize("path", [path for path in REAL if path.exists()], ids=lambda path: path.stem)
def test_real_assets_appear_in_every_tile(path: Path) -> None:
    pixels = np.asarray(Image.open(BytesIO(sheet(path.read_bytes(), 192))).convert("RGB"))
    for index in range(len(VIEWS)):
        row, column = (number * (96 + GAP) for number in divmod(index, COLUMNS))
        tile = pixels[row : row + 96, column : column + 96]
        assert 0.02 < (np.abs(tile.astype(int) - tile[0, 0]).max(axis=2) > 8).mean() < 0.9


def test_edges_of_an_unlit_cube_are_not_accentuated() -> None:
    """An ordinary viewer does not show them either."""
    glb = GlbWriter().mesh(
        CORNERS, CUBE_FACES, material=plain((0.2, 0.2, 0.2, 1), extensions={"KHR_materials_unlit": {}})
    )
    pixels = np.asarray(Image.open(BytesIO(sheet(glb.bytes(), 192))).convert("RGB")).astype(int)
    corner_view = pixels[96 + GAP : 192 + GAP, 30:66]
    assert np.ptp(corner_view[30:66].reshape(-1, 3), axis=0).max() <= 1
