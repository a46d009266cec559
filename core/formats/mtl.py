"""MTL: the materials of an OBJ."""

from collections.abc import Callable

import numpy as np

from core.formats.assembly import dropped
from core.formats.names import decode, texts
from core.formats.polygons import Material
from core.formats.text import joined_lines
from core.formats.textures import usable_image
from core.gltf.colors import linear
from core.notices import Notice

Load = Callable[[bytes], bytes | None]

Table = dict[str, bytes]  # values as they are written, by keyword

# Arguments of each option of a texture map; -o, -s and -t take one to three numbers.
_OPTIONS = {
    b"-blendu": 1,
    b"-blendv": 1,
    b"-boost": 1,
    b"-bm": 1,
    b"-cc": 1,
    b"-clamp": 1,
    b"-imfchan": 1,
    b"-mm": 2,
    b"-o": 3,
    b"-s": 3,
    b"-t": 3,
    b"-texres": 1,
    b"-type": 1,
}
_CARRIED = ("map_kd", "map_d", "norm")
_NOT_CARRIED = {
    "map_pr": "roughness",
    "map_pm": "metallic",
    "map_ke": "emission",
    "map_bump": "bump",
    "bump": "bump",
    "map_ks": "specular",
    "map_ns": "gloss",
    "disp": "displacement",
}


def read_mtl(data: bytes, load: Load) -> tuple[dict[bytes, Material], list[Notice]]:
    """The materials of an MTL by the bytes of their name, and warnings of properties that a glTF cannot hold.

    Kd is taken as sRGB and, as in modelling programs, replaced by the texture where there is one; d is the alpha; Ke,
    Pr, Pm and Ns (where Ks is not black) become emission, roughness and metallic. Ambient and specular colours have no
    counterpart. Numbers that are none are as if absent.

    Args:
        data: the file.
        load: the bytes of a texture by the path written in the MTL, in whatever code page; ``None`` where it is not in
            the upload.
    """
    tables: dict[bytes, Table] = {}
    current: Table = {}
    for line in joined_lines(data).splitlines():
        key, value = [*line.split(maxsplit=1), b"", b""][:2]
        keyword = key.decode("latin-1").lower()
        if keyword == "newmtl":
            current = tables.setdefault(value.strip(), {})
        elif keyword and not keyword.startswith("#"):
            current[keyword] = value if keyword in (*_CARRIED, *_NOT_CARRIED) else value.partition(b"#")[0]
    warnings: list[Notice] = []
    images, text = _Images(load, warnings), texts(tables)
    return {name: _material(text[name], table, images, warnings) for name, table in tables.items()}, warnings


class _Images:
    """Loads each texture once and warns once of one that cannot be carried."""

    def __init__(self, load: Load, warnings: list[Notice]) -> None:
        self.load = load
        self.warnings = warnings
        self.known: dict[bytes, bytes | None] = {}

    def __call__(self, table: Table, key: str) -> bytes | None:
        path = _path(table.get(key, b""))
        if path and path not in self.known:
            self.known[path] = usable_image(decode(path), self.load(path), self.warnings)
        return self.known.get(path)


def _material(name: str, table: Table, images: _Images, warnings: list[Notice]) -> Material:
    texture = images(table, "map_kd")
    opacity = images(table, "map_d")
    masked = opacity is not None and opacity == texture
    lost = [use for key, use in _NOT_CARRIED.items() if _path(table.get(key, b""))]
    lost += ["opacity"] if opacity is not None and not masked else []
    if lost:
        uses = ", ".join(dict.fromkeys(lost))
        warnings.append(dropped(f"The textures for {uses} of material {name[:60]!r} have no counterpart in a GLB."))
    if texture is not None and _is_moved(table["map_kd"]):
        warnings.append(dropped(f"The texture of material {name[:60]!r} is drawn without its scale and offset."))
    alpha = _numbers(table.get("d"), 1)
    if alpha is None and (transparency := _numbers(table.get("tr"), 1)) is not None and transparency[0] < 1:
        alpha = 1 - transparency  # MeshLab and others write the alpha here: no asset is wholly invisible
    color = _numbers(table.get("kd"), 3)
    rgb = (1.0, 1.0, 1.0) if texture is not None else (0.8, 0.8, 0.8) if color is None else _rgb(color)
    emissive = _numbers(table.get("ke"), 3)
    metallic = _numbers(table.get("pm"), 1)
    return Material(
        name,
        (*rgb, 1.0 if alpha is None else float(alpha[0])),
        0.0 if metallic is None else float(metallic[0]),
        _roughness(table),
        (0.0, 0.0, 0.0) if emissive is None else _rgb(emissive),
        texture,
        images(table, "norm"),
        masked,
    )


def _roughness(table: Table) -> float:
    if (given := _numbers(table.get("pr"), 1)) is not None:
        return float(given[0])
    specular, exponent = _numbers(table.get("ks"), 3), _numbers(table.get("ns"), 1, 1000.0)
    if exponent is None or specular is None or not specular.any():
        return 0.7
    return float((2 / (exponent[0] + 2)) ** 0.25)  # Beckmann's alpha for Phong's exponent is the square of glTF's


def _rgb(color: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float, float]:
    red, green, blue = (round(float(value), 6) for value in linear(color))
    return red, green, blue


def _numbers(text: bytes | None, count: int, most: float = 1.0) -> np.ndarray[tuple[int], np.dtype[np.float64]] | None:
    """The first numbers of a line, clipped to 0 and ``most``; a single number counts for all channels of a colour."""
    try:
        values = np.array([float(word) for word in (text or b"").split()[:count]], np.float64)
    except ValueError:
        return None
    if len(values) not in (1, count) or not np.isfinite(values).all():
        return None
    return np.clip(np.resize(values, count), 0, most)


def _is_moved(value: bytes) -> bool:
    """True where the options of a texture map scale it or move it."""
    words, neutral = value.split(), 0.0
    is_option = False
    for word in words:
        if _is_number(word):
            if is_option and float(word) != neutral:
                return True
            continue
        is_option = word in (b"-s", b"-o", b"-t")
        neutral = 1.0 if word == b"-s" else 0.0
    return False


def _path(value: bytes) -> bytes:
    """The file name behind the options of a texture map; it may have blanks."""
    words = value.strip()
    while words.startswith(b"-"):
        option, *rest = words.split(maxsplit=1)
        words = rest[0] if rest else b""
        for number in range(_OPTIONS.get(option.lower(), 0)):
            word, *rest = words.split(maxsplit=1) or [b""]
            if number > 0 and option.lower() in (b"-o", b"-s", b"-t") and not _is_number(word):
                break
            words = rest[0] if rest else b""
    return words.strip().strip(b'"')


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
