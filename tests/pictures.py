"""`make pictures`: draws the manual's pictures of what parameters do, by the product itself, from the demo asset.

Each picture is a row of results that differ in one parameter, seen from one side: as a whole, or a mark from near by.
Those of what metrics measure are in `tests.figures`.
"""

import argparse
import json
import math
import multiprocessing
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from PIL import Image

from core.choices import Evaluate
from core.formats.admission import admit, document_of
from core.gltf.scene import flatten
from core.parameters import parse_parameters
from core.pipeline import watermark
from core.rendering.cavity import cavity
from core.rendering.renderer import Frame, Renderer
from tests.figures import FIGURES
from tests.manual import MANUAL, ROOT
from tests.tiles import SUPERSAMPLING, TILE, row, tile, webp

ASSET = ROOT / "tests" / "data" / "spot.glb"
FOLDER = MANUAL / "pictures"
SIDE = (0.85, 0.3, -0.5)  # from the asset to the camera: head and flank
CLOSER = 0.88  # radius of the view of the whole asset over that of its sphere
LOGO = (
    b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">'
    b'<path fill-rule="evenodd" d="M50 2 93 26v48L50 98 7 74V26ZM50 26a24 24 0 1 0 .1 0Z"/></svg>'
)
RED = "#d02020"
HEAD: dict[str, Any] = {"box": {"min": [-0.6, 0.28, -0.8], "max": [0.6, 1, -0.02]}}


@dataclass(frozen=True)
class Picture:
    """A row of results.

    Attributes:
        cases: the caption and the parameters of each.
        near: how near the camera is: radius of the view over half the diagonal of the mark that most cameras see; 0
            shows the whole asset from one side.
        with_logo: a logo is embossed, too.
    """

    cases: tuple[tuple[str, dict[str, Any]], ...]
    near: float = 0
    with_logo: bool = False


def _of(name: str, values: list[Any], **others: Any) -> tuple[tuple[str, dict[str, Any]], ...]:
    """Cases in which one parameter has these values."""
    return tuple(
        (
            f"{name}: {value if isinstance(value, str) else json.dumps(value)}",
            {"text": "watermark"} | others | {name: value},
        )
        for value in values
    )


PICTURES = {
    "presets": Picture(
        tuple((name, {"text": "watermark", "preset": name}) for name in ("merchandise", "provenance", "paper")),
        near=1.3,
    ),
    "strength": Picture(_of("strength", ["discreet", "standard", "strong"], color=RED)),
    "size": Picture(_of("size", [2, 5, 10], color=RED, strength="strong")),
    "count": Picture(_of("count", [2, 8, 24], color=RED, strength="strong")),
    "seed": Picture(_of("seed", [0, 1, 2], color=RED, strength="strong")),
    "color": Picture(
        (
            *_of("color", ["auto", "none", RED]),
            ("two colours", {"text": "watermark", "color": ["#1040c0", "#ffc000"]}),
        )
    ),
    "profile": Picture(_of("profile", ["soft", "flat"], color="none"), near=1.15),
    "relief": Picture(_of("relief", [0.05, None, 0.25], color="none"), near=1.15),
    "mode": Picture(_of("mode", ["emboss", "deboss"], color="none"), near=1.15),
    "lines": Picture(
        (
            ("wrap: none", {"text": "SAMPLE ONLY", "wrap": "none", "color": RED}),
            ("wrap: auto", {"text": "SAMPLE ONLY", "wrap": "auto", "color": RED, "size": 3}),
            ("two lines", {"text": "SAMPLE\nnot for sale", "color": RED}),
        ),
        near=1.25,
    ),
    "align": Picture(
        tuple(
            (f"align: {side}", {"text": "SAMPLE\nnot for sale", "align": side, "color": RED})
            for side in ("left", "center", "right")
        ),
        near=1.25,
    ),
    "languages": Picture(
        tuple(
            (f"language: {tag}", {"text": "直骨", "language": tag, "color": RED})
            for tag in ("zh-Hans", "zh-Hant", "ja")
        ),
        near=1.35,
    ),
    "spacing": Picture(
        (
            ("as the font has it", {"text": "SAMPLE\nONLY", "color": RED}),
            ("letter_spacing: 0.3", {"text": "SAMPLE\nONLY", "letter_spacing": 0.3, "color": RED}),
            ("line_spacing: 2", {"text": "SAMPLE\nONLY", "line_spacing": 2, "color": RED}),
        ),
        near=1.25,
    ),
    "scripts": Picture(
        (
            ("Chinese, vertical", {"text": "样品展示", "direction": "vertical", "color": RED}),
            ("Arabic", {"text": "عينة", "color": RED}),
            ("Devanagari", {"text": "नमूना", "color": RED}),
        ),
        near=1.35,
    ),
    "logos": Picture(
        (
            ("logo", {"color": RED}),
            ("logo_position: left", {"text": "SAMPLE", "color": RED}),
            ("logo_position: above", {"text": "SAMPLE", "logo_position": "above", "color": RED}),
        ),
        near=1.35,
        with_logo=True,
    ),
    "qr": Picture(
        (
            ("qr", {"qr": "https://a.example/1", "keep_out": [HEAD]}),
            ("qr and text", {"qr": "https://a.example/1", "text": "SCAN ME", "keep_out": [HEAD]}),
        ),
        near=1.35,
    ),
    "regions": Picture(
        (
            ("nothing kept out", {"text": "watermark", "color": RED}),
            ("keep_out: the head's box", {"text": "watermark", "color": RED, "keep_out": [HEAD]}),
        )
    ),
    "labels": Picture(tuple((f"label: {name}", {"label": name}) for name in ("cn", "eu", "us-ca"))),
}
RESULT = "result"
NAMES = [*PICTURES, *FIGURES, RESULT]


def draw(picture: Picture) -> bytes:
    """WebP of a picture.

    Raises:
        MeshmarkError: a case is refused, or nothing can be drawn.
    """
    with Renderer(TILE * SUPERSAMPLING) as renderer:
        return row([(caption, _tile(renderer, asked, picture)) for caption, asked in picture.cases])


def _tile(renderer: Renderer, asked: dict[str, Any], picture: Picture) -> Image.Image:
    """One result."""
    parameters = parse_parameters(asked | {"evaluate": Evaluate.NONE})
    made = watermark(ASSET.read_bytes(), parameters, logo=LOGO if picture.with_logo else None, preview=False)
    scene = flatten(document_of(admit(made.model)))
    if not picture.near:
        renderer.load(scene)
        renderer.aim(Frame(renderer.frame.center, CLOSER * renderer.frame.radius))
        shown = cavity(*renderer.render_with_depth(SIDE, up=(0, 1, 0)))
    else:
        mark = max(made.report["watermarks"], key=lambda each: (each["views"], -each["id"]))
        surface = scene.surface
        x, y, z = ((np.array(mark["center"]) - surface.offset) * surface.scale).tolist()
        across = math.hypot(*mark["size"][:2]) * float(surface.scale) / 2
        renderer.load(scene, Frame((x, y, z), picture.near * across))
        shown = cavity(*renderer.render_with_depth(mark["normal"], up=mark["up"]))
    return tile(shown)


def draw_named(name: str) -> bytes:
    """WebP of a picture by its name; `result` is the preview of the job that the manual begins with."""
    if name in PICTURES:
        return draw(PICTURES[name])
    if name in FIGURES:
        return FIGURES[name]()
    preview = watermark(ASSET.read_bytes(), parse_parameters({"text": "watermark", "color": RED})).preview
    assert preview is not None
    return webp(Image.open(BytesIO(preview)))


def main() -> None:
    """Draws those that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    named = parser.parse_args().names or NAMES
    FOLDER.mkdir(exist_ok=True)
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        for name, content in zip(named, pool.imap(draw_named, named), strict=True):
            (FOLDER / f"{name}.webp").write_bytes(content)
            print(f"{name}.webp: {len(content) / 1024:.0f} KiB", flush=True)


if __name__ == "__main__":
    main()
