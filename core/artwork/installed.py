"""Fonts installed on this machine: the Noto family, by the scripts that its files are named after."""

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path

from fontTools.unicodedata import script_name

from core.artwork.typeface import Typeface, installed_faces

# Folders of Debian's packages fonts-noto-core, fonts-noto-cjk, fonts-symbola and fonts-hanazono.
SYSTEM = tuple(
    Path("/usr/share/fonts") / folder
    for folder in ("truetype/noto", "opentype/noto", "truetype/ancient-scripts", "truetype/hanazono")
)
SUFFIXES = (".ttf", ".otf", ".ttc", ".otc")

# Scripts that the CJK fonts draw, and the region whose shapes each language has. The names of collections and of
# single fonts differ: NotoSansCJK-Bold.ttc has "Noto Sans CJK JP Bold", and there is NotoSansJP-Bold.otf.
CJK = {"Bopo", "Hang", "Hani", "Hira", "Kana"}
REGIONS = {"zh-Hans": "SC", "zh-Hant": "TC", "zh-HK": "HK", "ja": "JP", "ko": "KR"}
# Names that are not the script's own.
NAMES = {"Latn": "", "Grek": "", "Cyrl": "", "Nkoo": "NKo", "Mero": "Meroitic", "Merc": "Meroitic"}
# For characters of no script, and for what the script's own font lacks.
GENERAL = (
    *("NotoSans", "NotoSansSymbols", "NotoSansSymbols2", "NotoSansMath", "NotoMusic", "NotoSansMayanNumerals"),
    *("NotoSansIndicSiyaqNumbers", "Symbola_hint"),
)
RARE_HAN = ("HanaMinA", "HanaMinB")
# Debian's packages, each with a file by which it is known.
PACKAGES = {
    "fonts-noto-core": "NotoSansSymbols2",
    "fonts-noto-cjk": "NotoSansCJK",
    "fonts-symbola": "Symbola_hint",
    "fonts-hanazono": "HanaMinB",
}


def font_folders() -> tuple[Path, ...]:
    """Folders of fonts: the one that ``MESHMARK_FONTS`` names, if it does, then those of Debian's packages."""
    own = os.environ.get("MESHMARK_FONTS")
    return (Path(own), *SYSTEM) if own else SYSTEM


def faces_for(script: str, region: str) -> Iterator[Typeface]:
    """The typefaces for a script, best first, opened one by one as they are asked for.

    Args:
        script: ISO 15924 code; "Zyyy" for characters of no script.
        region: of ideographs: SC, TC, HK, JP or KR.
    """
    if script in CJK:
        yield from _named((f"NotoSansCJK{region.lower()}", f"NotoSans{region}"))
        yield from (face for face in _named(("NotoSansCJK",)) if f"Sans CJK {region} " in f"{face.name} ")
        yield from _named(RARE_HAN)
    else:
        yield from _named(_stems(script))


def general_faces(region: str) -> Iterator[Typeface]:
    """The typefaces for whatever no typeface of its script has, best first; last any other in ``MESHMARK_FONTS``."""
    yield from _named(GENERAL)
    yield from faces_for("Hani", region)
    own = os.environ.get("MESHMARK_FONTS")
    for path in _files(Path(own)) if own else ():
        yield from installed_faces(path)


def packages_for(script: str) -> list[str]:
    """The Debian packages with fonts for a script that are not installed."""
    if script in CJK:
        wanted = ["fonts-noto-cjk", "fonts-hanazono"]
    else:
        wanted = ["fonts-noto-core", *(["fonts-symbola"] if script in ("Zyyy", "Zinh") else [])]
    return [package for package in wanted if PACKAGES[package] not in _index(font_folders())]


def _stems(script: str) -> Iterator[str]:
    """The names of font files for a script: sans first, the plain name before those that add to it."""
    name = NAMES.get(script, script_name(script, "").replace(" ", ""))
    for family in ("NotoSans", "NotoSerif"):
        yield family + name
        if name:
            yield from (stem for stem in _index(font_folders()) if stem.startswith(family + name))


def _named(stems: Iterable[str]) -> Iterator[Typeface]:
    index = _index(font_folders())
    for stem in stems:
        if stem in index:
            yield from installed_faces(index[stem])


@lru_cache(maxsize=4)
def _index(folders: tuple[Path, ...]) -> dict[str, Path]:
    """Font files by the first part of their names, as in NotoSansThai-Bold.ttf or NotoSansThai[wdth,wght].ttf.

    Of each family only its best weight in the first folder that has it: bold, else variable, else regular.
    """
    found: dict[str, dict[tuple[int, int], Path]] = defaultdict(dict)
    for number, folder in enumerate(folders):
        for path in _files(folder):
            stem, _, style = path.stem.replace("[", "-[").partition("-")
            if (rank := _rank(style.lstrip("-"))) is not None:
                found[stem].setdefault((number, rank), path)
    return {stem: styles[min(styles)] for stem, styles in sorted(found.items())}


def _rank(style: str) -> int | None:
    if style == "Bold":
        return 0
    if "wght" in style or style.startswith("VF"):
        return 1
    return 2 if style in ("Regular", "") else None


@lru_cache(maxsize=8)
def _files(folder: Path) -> tuple[Path, ...]:
    try:
        found = [path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file()]
    except OSError:  # it may be in a folder that is closed to this process
        return ()
    return tuple(sorted(found))
