"""Text of many scripts against another rasteriser of the same fonts: Pillow, with Raqm for the layout."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont, features
from scipy import ndimage

from core.arrays import Float
from core.artwork.itemization import FontChain, clusters_of, language_of
from core.artwork.layout import set_text
from core.artwork.line import row
from core.artwork.outline import text_artwork
from core.artwork.shaping import Spacing
from core.artwork.style import TextStyle
from core.artwork.typeface import installed_faces
from core.choices import Direction

NOTO = Path("/usr/share/fonts/truetype/noto")
CJK = Path("/usr/share/fonts/opentype/noto/NotoSansCJK-Bold.ttc")
EM = 240  # pixels

# By the font that Debian has for it; with the index where that is a collection.
TEXTS = {
    "NotoSansArabic-Bold": "نسخة للعرض",
    "NotoSansArmenian-Bold": "Նմուշ",
    "NotoSansBengali-Bold": "নমুনা প্রকাশ",
    "NotoSansCanadianAboriginal-Bold": "ᐃᓄᒃᑎᑐᑦ",
    "NotoSansCherokee-Bold": "ᏣᎳᎩ",
    "NotoSansDevanagari-Bold": "नमूना संस्करण",
    "NotoSansEthiopic-Bold": "አማርኛ",
    "NotoSansGeorgian-Bold": "ნიმუში",
    "NotoSansGujarati-Bold": "નમૂનો",
    "NotoSansGurmukhi-Bold": "ਨਮੂਨਾ",
    "NotoSansHebrew-Bold": "דוגמה",
    "NotoSansJavanese-Bold": "ꦗꦮ",
    "NotoSansKannada-Bold": "ಮಾದರಿ",
    "NotoSansKhmer-Bold": "គំរូ",
    "NotoSansLao-Bold": "ຕົວຢ່າງ",
    "NotoSansMalayalam-Bold": "മാതൃക",
    "NotoSansMongolian-Regular": "ᠮᠣᠩᠭᠣᠯ",
    "NotoSansMyanmar-Bold": "နမူနာ",
    "NotoSansNKo-Regular": "ߒߞߏ",
    "NotoSansOriya-Bold": "ନମୁନା",
    "NotoSansSinhala-Bold": "ආදර්ශය",
    "NotoSansSyriac-Regular": "ܣܘܪܝܝܐ",
    "NotoSansTamil-Bold": "மாதிரி",
    "NotoSansTelugu-Bold": "నమూనా",
    "NotoSansThaana-Bold": "ދިވެހި",
    "NotoSansThai-Bold": "ตัวอย่าง",
    "NotoSansTifinagh-Regular": "ⵜⵉⴼⵉⵏⴰⵖ",
    "NotoSansYi-Regular": "ꆈꌠ",
    "NotoSerifTibetan-Bold": "བོད་ཡིག",
    0: "見本の品です",
    1: "견본입니다",
    2: "生成内容",
    3: "樣品ㄅㄆ",
}


def path_of(font: str | int) -> Path:
    return CJK if isinstance(font, int) else NOTO / f"{font}.ttf"


def theirs(text: str, font: str | int, direction: str | None = None) -> tuple[NDArray[np.bool_], float]:
    """The picture of a text, cut to what is black, and its advance in ems."""
    assert features.check("raqm")
    path, index = path_of(font), font if isinstance(font, int) else 0
    pillow = ImageFont.truetype(BytesIO(path.read_bytes()), EM, index=index, layout_engine=ImageFont.Layout.RAQM)
    low_x, low_y, high_x, high_y = map(round, pillow.getbbox(text, direction=direction))
    picture = Image.new("L", (high_x - low_x + 40, high_y - low_y + 40))
    ImageDraw.Draw(picture).text((20 - low_x, 20 - low_y), text, 255, pillow, direction=direction)
    return cut(np.asarray(picture) > 127), pillow.getlength(text, direction=direction) / EM


def cut(black: NDArray[np.bool_]) -> NDArray[np.bool_]:
    rows, columns = np.flatnonzero(black.any(axis=1)), np.flatnonzero(black.any(axis=0))
    return black[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def ours(rings: tuple[Float, ...], aspect: float, width: int, height: int) -> NDArray[np.bool_]:
    """Rings as a picture of a size, by their parity."""
    black = np.zeros((4 * height, 4 * width), dtype=bool)
    for ring in rings:
        picture = Image.new("1", (4 * width, 4 * height))
        corners = (ring * [1, -1] + [0.5, aspect / 2]) * [4 * width, 4 * height / aspect]
        ImageDraw.Draw(picture).polygon([(x - 0.5, y - 0.5) for x, y in corners.tolist()], fill=1)
        black ^= np.asarray(picture)
    covered: NDArray[np.bool_] = black.reshape(height, 4, width, 4).mean(axis=(1, 3)) > 0.5
    return covered


def holes(black: NDArray[np.bool_]) -> int:
    """White regions, larger than a speck, that do not reach the edge."""
    regions, count = ndimage.label(np.pad(~black, 1, constant_values=True))
    sizes = ndimage.sum_labels(np.ones_like(regions), regions, range(2, count + 1))
    return int((sizes > 12).sum())


@pytest.mark.parametrize(("font", "text"), TEXTS.items())
def test_a_text_has_the_shapes_holes_order_and_advance_that_another_rasteriser_draws(
    font: str | int, text: str
) -> None:
    face = installed_faces(path_of(font))[font if isinstance(font, int) else 0]
    assert [used.name for used in set_text(text).faces] == [face.name]
    picture, advance = theirs(text, font)
    plain = text_artwork(text, None if isinstance(font, int) else path_of(font).read_bytes())  # as bold as it comes
    height, width = picture.shape
    assert plain.aspect == pytest.approx(height / width, rel=0.02)
    drawn = ours(plain.rings, plain.aspect, width, height)
    assert (drawn ^ picture).sum() < 0.06 * picture.sum()  # of thin strokes, much is edge
    assert drawn.sum() == pytest.approx(picture.sum(), rel=0.03)
    assert holes(drawn) == holes(picture)
    chain = FontChain(language_of(text, None))
    (pieces,) = chain.choose([clusters_of(text)])
    line = row(pieces, Spacing(face.upem, han=chain.language))
    assert line.advance / face.upem == pytest.approx(advance, rel=0.01)


@pytest.mark.parametrize(("index", "text"), [(0, "見本「の」品ー。"), (1, "견본"), (2, "生成、内容"), (3, "樣品ㄅㄆ")])
def test_a_column_is_set_as_another_layout_engine_sets_it(index: int, text: str) -> None:
    picture, advance = theirs(text, index, direction="ttb")
    column = text_artwork(text, style=TextStyle(direction=Direction.VERTICAL))
    height, width = picture.shape
    assert column.aspect == pytest.approx(height / width, rel=0.02)
    drawn = ours(column.rings, column.aspect, width, height)
    assert (drawn ^ picture).sum() < 0.06 * picture.sum()
    assert advance == pytest.approx(len(text), rel=0.01)
