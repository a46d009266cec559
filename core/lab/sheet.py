"""A contact sheet of cases to look at: of each, one mark from the front and the whole asset from the same side.

``python -m core.lab.sheet CASES.json SHEET.png`` marks the assets that a list of cases names, such as
``[{"label": "dark", "asset": "fox.glb", "parameters": {"text": "SAMPLE"}}]``; paths are relative to the list's folder.
"""

import argparse
import math
from io import BytesIO
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from pydantic import BaseModel, ConfigDict, TypeAdapter

from core.choices import Evaluate
from core.errors import MeshmarkError
from core.formats.admission import admit, document_of
from core.gltf.scene import Scene, flatten
from core.parameters import parse_parameters
from core.pipeline import watermark
from core.rendering.cavity import cavity
from core.rendering.renderer import Frame, Renderer

TILE = 256  # pixels; side of a picture
SUPERSAMPLING = 2  # samples a pixel and axis
CAPTION = 34  # pixels; height of the strip with a case's label, two lines
COLUMNS = 4  # cases side by side
GAP = 6  # pixels between cases
AROUND = 1.2  # radius of a mark's picture over half the diagonal of its front
LINE = 40  # characters of an error's message side by side
PAPER, INK = (255, 255, 255), (20, 20, 20)


class Case(BaseModel):
    """An asset to be marked and shown.

    Attributes:
        label: below its pictures.
        asset: a file of any accepted format.
        parameters: of the job; its metrics are not measured.
        logo: an SVG file that is embossed, too.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    label: str
    asset: Path
    parameters: dict[str, Any]
    logo: Path | None = None

    def within(self, folder: Path) -> "Case":
        """The same case, with paths relative to a ``folder``."""
        logo = None if self.logo is None else folder / self.logo
        return self.model_copy(update={"asset": folder / self.asset, "logo": logo})


def sheet(cases: list[Case]) -> bytes:
    """PNG of all ``cases``, row by row; of one that is refused the error is shown in place of its pictures.

    Raises:
        MeshmarkError: ``rendering_unavailable``.
    """
    columns = min(COLUMNS, len(cases))
    rows = math.ceil(len(cases) / COLUMNS)
    width, height = 2 * TILE + GAP, TILE + CAPTION + GAP
    page = Image.new("RGB", (columns * width, rows * height), PAPER)
    with Renderer(TILE * SUPERSAMPLING) as renderer:
        for number, case in enumerate(cases):
            row, column = divmod(number, COLUMNS)
            page.paste(_tile(case, renderer), (column * width, row * height))
    stream = BytesIO()
    page.save(stream, format="PNG")
    return stream.getvalue()


def _tile(case: Case, renderer: Renderer) -> Image.Image:
    """The two pictures of a case, or its error, above its label."""
    tile = Image.new("RGB", (2 * TILE, TILE + CAPTION), PAPER)
    pen = ImageDraw.Draw(tile)
    try:
        asked = parse_parameters(case.parameters | {"evaluate": Evaluate.NONE})
        logo = None if case.logo is None else case.logo.read_bytes()
        made = watermark(case.asset.read_bytes(), asked, logo=logo, preview=False)
    except MeshmarkError as error:
        pen.multiline_text((8, 8), "\n".join(wrap(f"{error.code}: {error}", 2 * LINE)), fill=INK)
        pen.text((4, TILE + 4), case.label, fill=INK)
        return tile
    marks = made.report["watermarks"]
    scene = flatten(document_of(admit(made.model)))
    best = max(marks, key=lambda mark: (mark["views"], -mark["id"]))
    for place, picture in enumerate(_pictures(scene, best, renderer)):
        tile.paste(picture.reduce(SUPERSAMPLING), (place * TILE, 0))
    drawn = best["color"] or "no colour"
    pen.text((4, TILE + 4), f"{case.label}\n{len(marks)} marks; this one {drawn}", fill=INK)
    return tile


def _pictures(scene: Scene, mark: dict[str, Any], renderer: Renderer) -> tuple[Image.Image, Image.Image]:
    """A mark of a report from the front, and the asset from there; folds are accentuated in the second as in the
    preview, in the first nothing is."""
    surface = scene.surface
    x, y, z = ((np.array(mark["center"]) - surface.offset) * surface.scale).tolist()
    across = float(np.hypot(*mark["size"][:2])) * surface.scale / 2
    renderer.load(scene, Frame((x, y, z), AROUND * across))
    front = renderer.render(mark["normal"], mark["up"])
    renderer.load(scene)
    whole = cavity(*renderer.render_with_depth(mark["normal"], up=mark["up"]))
    return Image.fromarray(front), Image.fromarray(whole)


def main() -> None:
    """Draw the sheet of a list of cases."""
    parser = argparse.ArgumentParser(prog="python -m core.lab.sheet", description=main.__doc__)
    parser.add_argument("cases", type=Path, metavar="CASES.json")
    parser.add_argument("out", type=Path, metavar="SHEET.png")
    options = parser.parse_args()
    listed = TypeAdapter(list[Case]).validate_json(options.cases.read_bytes())
    folder = options.cases.parent
    options.out.write_bytes(sheet([case.within(folder) for case in listed]))


if __name__ == "__main__":
    main()
