from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from core.lab.sheet import CAPTION, GAP, TILE, Case, sheet

SPOT = Path(__file__).parents[2] / "data" / "spot.glb"


def test_each_case_shows_a_mark_in_the_middle_and_a_refused_one_its_error(tmp_path: Path) -> None:
    other = tmp_path / "notes.glb"
    other.write_bytes(b"no asset at all")
    cases = [
        Case(label="red", asset=SPOT, parameters={"text": "SAMPLE", "color": "#d02020"}),
        Case(label="refused", asset=other, parameters={"text": "SAMPLE"}),
    ]
    page = np.asarray(Image.open(BytesIO(sheet(cases))))
    assert page.shape == (TILE + CAPTION + GAP, 2 * (2 * TILE + GAP), 3)
    front = page[:TILE, :TILE]
    red = front[..., 0].astype(int) - front[..., 1] > 100
    rows, columns = (np.flatnonzero(red.any(axis=axis)) for axis in (1, 0))
    assert columns[-1] - columns[0] > 0.75 * TILE  # the mark fills the width of its picture, in the middle of it
    assert abs(rows.mean() - TILE / 2) < 0.1 * TILE
    assert abs(columns.mean() - TILE / 2) < 0.1 * TILE
    refused = page[:TILE, 2 * TILE + GAP :]
    assert 0 < (refused < 128).any(axis=2).mean() < 0.1  # writing, no picture
