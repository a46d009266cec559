import os
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.errors import ErrorCode, MeshmarkError
from core.rendering.preview import COLUMNS, GAP, VIEWS, contact_sheet
from tests.core.rendering.glb import cube

MESHES = Path(os.environ.get("MESHMARK_TEST_MESHES", Path(__file__).parents[4] / "shared" / "meshes"))
REAL = [MESHES / name for name in ("fox.glb", "egyptian-cat.glb", "mage-kaykit.glb", "truck-yellow-kenney.glb")]


def test_the_sheet_is_a_png_of_eight_tiles_that_all_show_the_asset() -> None:
    sheet = Image.open(BytesIO(contact_sheet(cube((1, 0, 0, 1)), tile=64)))
    assert sheet.format == "PNG"
    assert sheet.size == (4 * 64 + 3 * GAP, 2 * 64 + GAP)
    pixels = np.asarray(sheet.convert("RGB"))
    tiles = []
    for index in range(len(VIEWS)):
        row, column = (number * (64 + GAP) for number in divmod(index, COLUMNS))
        tiles.append(pixels[row : row + 64, column : column + 64])
        assert tiles[-1][32, 32, 0] > 2 * tiles[-1][32, 32, 1]


def test_the_first_tile_shows_the_front() -> None:
    pixels = np.asarray(Image.open(BytesIO(contact_sheet(cube(), tile=64))).convert("RGB"))
    np.testing.assert_array_equal(pixels[32, 64 : 64 + GAP], 255)


def test_the_sheet_is_the_same_each_time() -> None:
    assert contact_sheet(cube(), tile=48) == contact_sheet(cube(), tile=48)


def test_a_broken_file_is_refused_with_the_code_of_its_reader() -> None:
    with pytest.raises(MeshmarkError) as caught:
        contact_sheet(cube()[:-20], tile=32)
    assert caught.value.code == ErrorCode.TRUNCATED_FILE


@pytest.mark.parametrize("path", [path for path in REAL if path.exists()], ids=lambda path: path.stem)
def test_real_assets_appear_in_every_tile(path: Path) -> None:
    pixels = np.asarray(Image.open(BytesIO(contact_sheet(path.read_bytes(), tile=96))).convert("RGB"))
    for index in range(len(VIEWS)):
        row, column = (number * (96 + GAP) for number in divmod(index, COLUMNS))
        tile = pixels[row : row + 96, column : column + 96]
        assert 0.02 < (np.abs(tile.astype(int) - tile[0, 0]).max(axis=2) > 8).mean() < 0.9
