"""A text is set in the ways that its places may need; the report says in which it stands."""

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

from core import marking
from core.artwork.lettering import layouts_of
from core.choices import Direction, Evaluate, Wrap
from core.errors import ErrorCode, MeshmarkError
from core.parameters import Parameters
from core.pipeline import watermark
from core.stages import Request, Run

SENTENCE = "Sample only - purchase the licensed model at example-market"


def lines_of(**asked: object) -> list[tuple[str, ...]]:
    """The lines of each way in which a text is set."""
    run = Run(Request(Parameters.model_validate(asked).resolved()), lambda _: None, lambda *_: None)
    return [artwork.lines for artwork in marking.letter(run).artworks]


def test_a_long_text_may_stand_in_one_to_four_lines() -> None:
    assert [len(lines) for lines in lines_of(text=SENTENCE)] == [1, 2, 3, 4]
    assert {" ".join(lines) for lines in lines_of(text=SENTENCE)} == {SENTENCE}


@pytest.mark.parametrize(
    ("asked", "lines"),
    [
        ({"text": "watermark"}, ("watermark",)),
        ({"text": SENTENCE, "wrap": Wrap.NONE}, (SENTENCE,)),
        ({"text": "ORDER\n4711 AB"}, ("ORDER", "4711 AB")),
    ],
    ids=["a word", "asked for one line", "has lines of its own"],
)
def test_other_text_stands_as_it_was_sent(asked: dict[str, object], lines: tuple[str, ...]) -> None:
    assert lines_of(**asked) == [lines]


def test_the_report_says_in_which_lines_each_mark_stands() -> None:
    block = trimesh.creation.box(extents=(30.0, 24.0, 2.0)).export(file_type="stl")
    report = watermark(block, Parameters(text=SENTENCE, count=3, evaluate=Evaluate.NONE), preview=False).report
    assert [" ".join(mark["lines"]) for mark in report["watermarks"]] == [SENTENCE] * len(report["watermarks"])
    assert max(len(mark["lines"]) for mark in report["watermarks"]) > 1


def codes(extents: tuple[float, float, float] = (30.0, 24.0, 2.0), **asked: object) -> dict[str, Any]:
    """The report of a plate, of light grey as an STL has it, with QR codes."""
    plate = trimesh.creation.box(extents=extents).export(file_type="stl")
    asked |= {"qr": "https://a.example", "count": 2, "evaluate": "none"}
    return watermark(plate, Parameters.model_validate(asked), preview=False).report


def test_a_qr_code_without_a_colour_is_noticed_and_one_that_has_its_own_is_not() -> None:
    (notice,) = codes(color="none")["warnings"]
    assert notice["code"] == "unreadable_qr"
    assert "2 of 2" in notice["message"]
    colored = codes(color="auto")
    assert colored["warnings"] == []
    assert {mark["logo"] for mark in colored["watermarks"]} == {"qr"}


@pytest.mark.parametrize(("text", "slats"), [("", 3.2), ("AB", 3.5)])
def test_where_there_is_little_room_a_qr_code_becomes_no_smaller_than_it_can_be_read(text: str, slats: float) -> None:
    marks = codes((30.0, slats, 1.0), text=text)["watermarks"]
    assert marks
    (layout,) = layouts_of(Parameters(text=text, qr="https://a.example")).artworks
    assert min(mark["size"][0] for mark in marks) >= layout.least_width * (1 - 1e-6)
    with pytest.raises(MeshmarkError) as caught:
        codes((30.0, 1.5, 1.0), text=text)
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert caught.value.message.startswith(f"No place for the QR code{' with the text' if text else ''} was found")
    assert caught.value.remedy == f"Use a shorter {'text or ' if text else ''}address."


def test_letters_are_flat_where_the_files_coordinates_cannot_hold_soft_ones_and_the_report_says_so() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    ball.vertices += (1000, 0, 0)
    asked = Parameters(text="watermark", count=4, evaluate=Evaluate.NONE)
    report = watermark(ball.export(file_type="glb"), asked, preview=False).report
    assert {mark["cut"] for mark in report["watermarks"]} == {"split"}
    (notice,) = report["warnings"]
    assert notice["code"] == "flat_letters"
    number = len(report["watermarks"])
    assert number >= 3
    assert notice["message"].startswith(f"{number} of {number} marks have flat letters: ")
    ball.vertices += (-1000, 0, 0)
    here = watermark(ball.export(file_type="glb"), asked, preview=False).report
    assert {mark["cut"] for mark in here["watermarks"]} == {"delaunay"}
    ball.vertices += (100_000, 0, 0)
    with pytest.raises(MeshmarkError, match="32-bit coordinates are too coarse") as caught:
        watermark(ball.export(file_type="glb"), asked, preview=False)
    assert "origin" in caught.value.remedy


def test_a_logo_that_is_small_everywhere_is_noticed_as_one() -> None:
    plate = trimesh.creation.box(extents=(30.0, 24.0, 2.0)).export(file_type="stl")
    logo = b"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 9 9'><path d='M0 0h9v9H0z M3 3v3h3V3z'/></svg>"
    asked = Parameters(size=0.6, count=1, evaluate=Evaluate.NONE)
    (notice,) = watermark(plate, asked, logo=logo, preview=False).report["warnings"]
    assert notice["code"] == "small_text"
    assert notice["message"].startswith("No logo on this asset reads well: its details are 0.15 high")
    assert notice["remedy"] == "Ask for a larger `size`, or use a simpler logo."


@pytest.mark.parametrize(
    ("extents", "tall"), [((2.0, 30.0, 2.0), True), ((30.0, 2.0, 30.0), False)], ids=["a pillar", "a slab"]
)
def test_ideographs_stand_in_columns_where_the_place_is_tall_and_in_rows_where_it_is_wide(
    extents: tuple[float, float, float], tall: bool
) -> None:
    block = trimesh.creation.box(extents=extents).export(file_type="stl")
    asked = Parameters(text="見本透かし", direction=Direction.AUTO, count=8, evaluate=Evaluate.NONE, seed=3)
    marks = watermark(block, asked, preview=False).report["watermarks"]
    area = {True: 0.0, False: 0.0}
    for mark in marks:
        width, height, _ = mark["size"]
        if abs(mark["normal"][1]) < 0.9 or not tall:  # the ends of a pillar are square
            area[height > width] += width * height
    assert area[tall] > 4 * area[not tall], "but for a few small marks"
    assert all(mark["up"][1] > 0.9 or abs(mark["normal"][1]) > 0.9 for mark in marks)


def plate(texture: NDArray[np.uint8]) -> bytes:
    """A GLB of a plate with a picture on its front and its back."""
    x, y, z = (np.array([-1, 1, 1, -1]) * 15.0, np.array([-1, -1, 1, 1]) * 12.0, np.full(4, 1.0))
    front = np.column_stack([x, y, z])
    uv = np.tile([[0, 0], [1, 0], [1, 1], [0, 1]], (2, 1))
    faces = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]
    image = Image.fromarray(texture)
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)  # type: ignore[no-untyped-call]
    mesh = trimesh.Trimesh(
        np.concatenate([front, front * (1, 1, -1)]),
        faces,
        visual=trimesh.visual.TextureVisuals(uv=uv, material=material),  # type: ignore[no-untyped-call]
        process=False,
    )
    glb = mesh.export(file_type="glb")
    assert isinstance(glb, bytes)
    return glb


def fur(columns: int = 50) -> NDArray[np.uint8]:
    """A light picture with dark spots as high as letters in its first ``columns`` of 50."""
    picture = np.full((40, 50, 3), 200, np.uint8)
    picture[:, :columns] = np.random.default_rng(0).choice([0, 230], (40, columns, 1))
    return np.repeat(np.repeat(picture, 8, axis=0), 8, axis=1)


def marked(texture: NDArray[np.uint8], **asked: object) -> dict[str, Any]:
    asked |= {"text": "watermark", "size": 3.2, "count": 2, "evaluate": "none"}
    return watermark(plate(texture), Parameters.model_validate(asked), preview=False).report


def test_letters_without_a_colour_on_fur_are_noticed_and_a_colour_is_advised() -> None:
    (notice,) = marked(fur(), color="none", seed=4)["warnings"]
    assert notice["code"] == "hard_to_read"
    assert "2 of 2 marks" in notice["message"]
    assert "auto" in notice["remedy"]


@pytest.mark.parametrize(("columns", "color"), [(0, "none"), (50, "auto")], ids=["plain ground", "a colour"])
def test_letters_on_plain_ground_and_letters_of_a_colour_are_not_noticed(columns: int, color: str) -> None:
    assert "hard_to_read" not in {notice["code"] for notice in marked(fur(columns), color=color)["warnings"]}


def test_letters_without_a_colour_stand_beside_the_fur_where_there_is_room() -> None:
    report = marked(fur(30), color="none")
    assert report["warnings"] == []
    left = 0.2 * 15.0
    assert all(mark["center"][0] - mark["size"][0] / 2 > left for mark in report["watermarks"])
