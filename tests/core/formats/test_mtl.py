import pytest

from core.formats.mtl import read_mtl
from core.formats.polygons import Material
from tests.core.formats.samples import png

IMAGE = png(1, 2, 3)


def _one(text: str) -> Material:
    materials, _ = read_mtl(b"newmtl a\n" + text.encode(), lambda _path: IMAGE)
    return materials[b"a"]


def test_a_material_that_says_nothing_is_grey_and_opaque() -> None:
    assert _one("") == Material("a", (0.8, 0.8, 0.8, 1.0))


@pytest.mark.parametrize(
    ("text", "color"),
    [
        ("Kd 1 0.5 0", (1.0, 0.214041, 0.0, 1.0)),
        ("Kd 0.5 # grey", (0.214041, 0.214041, 0.214041, 1.0)),
        ("Kd 2 -1 0", (1.0, 0.0, 0.0, 1.0)),
        ("Kd red", (0.8, 0.8, 0.8, 1.0)),
        ("Kd nan 0 0", (0.8, 0.8, 0.8, 1.0)),
        ("Kd 0 0 0\nd 0.25", (0.0, 0.0, 0.0, 0.25)),
        ("Kd 0 0 0\nTr 0.25", (0.0, 0.0, 0.0, 0.75)),
        ("Kd 0 0 0\nTr 1.0", (0.0, 0.0, 0.0, 1.0)),
        ("Kd 0 0 0\nmap_Kd a.png", (1.0, 1.0, 1.0, 1.0)),
    ],
)
def test_colour_and_transparency(text: str, color: tuple[float, ...]) -> None:
    assert _one(text).color == color


@pytest.mark.parametrize(
    ("text", "roughness", "metallic"),
    [
        ("Pr 0.25\nPm 1", 0.25, 1.0),
        ("Ns 1000\nKs 0 0 0", 0.7, 0.0),
        ("Ns 0\nKs 1 1 1", 1.0, 0.0),
        ("Ns 1000\nKs 1 1 1", pytest.approx(0.211, abs=0.001), 0.0),
    ],
)
def test_roughness_and_metal(text: str, roughness: float, metallic: float) -> None:
    assert (_one(text).roughness, _one(text).metallic) == (roughness, metallic)


@pytest.mark.parametrize(
    "line",
    [
        "map_Kd a b.png",
        "map_Kd\ta b.png",
        'MAP_KD "a b.png"',
        "map_Kd -s 1 1 1 -o 0 0 a b.png",
        "map_Kd -clamp on -mm 0 1 -blendu off a b.png",
    ],
)
def test_the_name_of_a_texture_stands_behind_its_options(line: str) -> None:
    asked: list[bytes] = []
    _, warnings = read_mtl(f"newmtl a\n{line}\n".encode(), lambda path: asked.append(path) or IMAGE)  # type: ignore[func-returns-value]
    assert asked == [b"a b.png"]
    assert warnings == []


def test_the_texture_as_its_own_opacity_cuts_out() -> None:
    assert _one("map_Kd a.png\nmap_d a.png").masked
    assert not _one("map_Kd a.png").masked
