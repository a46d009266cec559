"""MTL: the materials of an OBJ."""

from collections.abc import Callable

import numpy as np

from core.asset.assembly import dropped
from core.asset.polygons import Material, linear
from core.asset.textures import usable_image
from core.errors import MeshmarkError

Load = Callable[[str], bytes | None]

# How many arguments an option of a texture map takes; -o, -s and -t take one to three numbers.
_OPTIONS = {
    "-blendu": 1,
    "-blendv": 1,
    "-boost": 1,
    "-bm": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-mm": 2,
    "-o": 3,
    "-s": 3,
    "-t": 3,
    "-texres": 1,
    "-type": 1,
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


def read_mtl(data: bytes, load: Load) -> tuple[dict[str, Material], list[MeshmarkError]]:
    """The materials of an MTL by name, and what of them a glTF cannot hold.

    Kd is taken as sRGB and, as in modelling programs, replaced by the texture where there is one; d is the alpha; Ke,
    Pr, Pm and Ns (where Ks is not black) become emission, roughness and metallic. Ambient and specular colours have no
    counterpart. Numbers that are none are as if absent.

    Args:
        data: the file.
        load: the bytes of a texture by the path written in the MTL; ``None`` where it is not in the upload.
    """
    tables: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    for line in data.decode("utf-8", "replace").replace("\\\n", " ").splitlines():
        key, _, value = line.strip().partition(" ")
        if "\t" in key:
            key, _, value = line.strip().partition("\t")
        if key.lower() == "newmtl":
            current = tables.setdefault(value.strip(), {})
        elif key and not key.startswith("#"):
            current[key.lower()] = value if key.lower() in (*_CARRIED, *_NOT_CARRIED) else value.partition("#")[0]
    warnings: list[MeshmarkError] = []
    images = _Images(load, warnings)
    return {name: _material(name, table, images, warnings) for name, table in tables.items()}, warnings


class _Images:
    """Loads each texture once and says once what cannot be carried."""

    def __init__(self, load: Load, warnings: list[MeshmarkError]) -> None:
        self.load = load
        self.warnings = warnings
        self.known: dict[str, bytes | None] = {}

    def __call__(self, table: dict[str, str], key: str) -> bytes | None:
        path = _path(table.get(key, ""))
        if path and path not in self.known:
            self.known[path] = usable_image(path, self.load(path), self.warnings)
        return self.known.get(path)


def _material(name: str, table: dict[str, str], images: _Images, warnings: list[MeshmarkError]) -> Material:
    texture = images(table, "map_kd")
    opacity = images(table, "map_d")
    masked = opacity is not None and opacity == texture
    lost = [use for key, use in _NOT_CARRIED.items() if _path(table.get(key, ""))]
    lost += ["opacity"] if opacity is not None and not masked else []
    if lost:
        uses = ", ".join(dict.fromkeys(lost))
        warnings.append(dropped(f"The textures for {uses} of material {name[:60]!r} have no counterpart in a GLB."))
    if texture is not None and _is_moved(table["map_kd"]):
        warnings.append(dropped(f"The texture of material {name[:60]!r} is drawn without its scale and offset."))
    alpha = _numbers(table.get("d"), 1)
    if alpha is None and (transparency := _numbers(table.get("tr"), 1)) is not None and transparency[0] < 1:
        alpha = 1 - transparency  # MeshLab and others write the alpha here: nobody sells what is wholly invisible
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


def _roughness(table: dict[str, str]) -> float:
    if (given := _numbers(table.get("pr"), 1)) is not None:
        return float(given[0])
    specular, exponent = _numbers(table.get("ks"), 3), _numbers(table.get("ns"), 1, 1000.0)
    if exponent is None or specular is None or not specular.any():
        return 0.7
    return float((2 / (exponent[0] + 2)) ** 0.25)  # Beckmann's alpha for Phong's exponent is the square of glTF's


def _rgb(color: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float, float]:
    red, green, blue = (round(float(value), 6) for value in linear(color))
    return red, green, blue


def _numbers(text: str | None, count: int, most: float = 1.0) -> np.ndarray[tuple[int], np.dtype[np.float64]] | None:
    """The first numbers of a line, clipped to 0 and ``most``; one number stands for all of a colour."""
    try:
        values = np.array([float(word) for word in (text or "").split()[:count]], np.float64)
    except ValueError:
        return None
    if len(values) not in (1, count) or not np.isfinite(values).all():
        return None
    return np.clip(np.resize(values, count), 0, most)


def _is_moved(value: str) -> bool:
    """Whether the options of a texture map scale it or move it."""
    words, neutral = value.split(), 0.0
    is_option = False
    for word in words:
        if _is_number(word):
            if is_option and float(word) != neutral:
                return True
            continue
        is_option = word in ("-s", "-o", "-t")
        neutral = 1.0 if word == "-s" else 0.0
    return False


def _path(value: str) -> str:
    """The file name behind the options of a texture map; it may have blanks."""
    words = value.strip()
    while words.startswith("-"):
        option, *rest = words.split(maxsplit=1)
        words = rest[0] if rest else ""
        for number in range(_OPTIONS.get(option.lower(), 0)):
            word, *rest = words.split(maxsplit=1) or [""]
            if number > 0 and option.lower() in ("-o", "-s", "-t") and not _is_number(word):
                break
            words = rest[0] if rest else ""
    return words.strip().strip('"')


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
