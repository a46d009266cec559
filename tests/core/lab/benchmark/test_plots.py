"""Plots are drawn of what there is, the same bytes each time."""

from pathlib import Path

import numpy as np
from PIL import Image

from core.lab.benchmark.plots import write_plots
from tests.core.lab.benchmark.test_tables import refused, row

ROWS = [
    row(asset, method, count, wps=0.5 + turn / 50, ss=0.9 - count / 500, ocr=count / 40, smse=count / 1e4, ray=0.9,
        prominence=count / 800, vertices=1000 * 10**turn, run=0.1 * 4**turn)
    for turn, asset in enumerate(("a", "b", "c"))
    for method in ("meshmark", "li", "paper")
    for count in (4, 16, 32)
]  # fmt: skip


def test_every_figure_is_written_as_png_and_svg_with_something_on_it(tmp_path: Path) -> None:
    drawn = write_plots(ROWS, tmp_path)
    assert [path.name for path in drawn] == ["trade-off.png", "visibility.png", "prominence.png", "run-time.png"]
    for path in drawn:
        picture = np.asarray(Image.open(path).convert("RGB"))
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
        assert path.with_suffix(".svg").read_text().lstrip().startswith("<?xml")


def test_the_same_rows_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("first", "second"):
        write_plots(ROWS, tmp_path / name)
    for path in (tmp_path / "first").iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes()


def test_a_figure_without_values_is_left_out(tmp_path: Path) -> None:
    assert [path.name for path in write_plots([row("a", "li", ray=0.5)], tmp_path)] == ["run-time.png"]
    assert write_plots([refused("a", "li")], tmp_path) == []
