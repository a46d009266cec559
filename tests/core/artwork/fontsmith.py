"""Small fonts drawn on the spot, so that each test shows the outlines it talks about."""

from collections.abc import Sequence
from io import BytesIO

from fontTools.feaLib.builder import addOpenTypeFeaturesFromString
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.t2CharStringPen import T2CharStringPen
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.ttLib import TTFont
from fontTools.ttLib.tables.TupleVariation import TupleVariation

Contour = Sequence[tuple[int, int]]

# Clockwise, as TrueType wants outer contours.
SQUARE: Contour = [(0, 0), (0, 500), (500, 500), (500, 0)]


def box(x: int, y: int, width: int, height: int) -> Contour:
    return [(x, y), (x, y + height), (x + width, y + height), (x + width, y)]


def _widening(contours: Sequence[Contour], axis: str) -> TupleVariation:
    points = [point for contour in contours for point in contour]
    phantom = [(0, 0)] * 4
    return TupleVariation({axis: (0.0, 1.0, 1.0)}, [(x, 0) for x, _ in points] + phantom)


def make_font(glyphs: dict[str, Sequence[Contour]], advance: int = 600, cff: bool = False, widened: str = "") -> bytes:
    """A font that draws each character of ``glyphs`` as straight contours; 1000 units per em.

    ``widened`` names a variation axis that makes every glyph twice as wide; its default leaves them as they are.
    """
    order = [".notdef", *(f"uni{ord(character):04X}" for character in glyphs)]
    builder = FontBuilder(1000, isTTF=not cff)
    builder.setupGlyphOrder(order)
    builder.setupCharacterMap({ord(character): name for character, name in zip(glyphs, order[1:], strict=True)})
    outlines = dict(zip(order, [[SQUARE], *glyphs.values()], strict=True))
    if cff:
        pens = {name: T2CharStringPen(advance, None) for name in order}
    else:
        pens = {name: TTGlyphPen(None) for name in order}
    for name, contours in outlines.items():
        for contour in contours:
            pens[name].moveTo(contour[0])
            for point in contour[1:]:
                pens[name].lineTo(point)
            pens[name].closePath()
    if cff:
        builder.setupCFF("Test", {}, {name: pen.getCharString() for name, pen in pens.items()}, {})
    else:
        builder.setupGlyf({name: pen.glyph() for name, pen in pens.items()})
    builder.setupHorizontalMetrics(dict.fromkeys(order, (advance, 0)))
    builder.setupHorizontalHeader()
    builder.setupNameTable({"familyName": "Test", "styleName": "Regular"})
    builder.setupOS2()
    builder.setupPost()
    if widened:
        builder.setupFvar([(widened, 100, 100, 700, "Axis")], [])
        builder.setupGvar({name: [_widening(outlines[name], widened)] for name in order})
    stream = BytesIO()
    builder.save(stream)
    return stream.getvalue()


def growing(levels: int) -> bytes:
    """A font whose rules make twenty of each "a", so many times over."""
    font = TTFont(BytesIO(make_font({"a": [SQUARE]})))
    lookups = "".join(f"lookup L{level} {{ sub uni0061 by {'uni0061 ' * 20}; }} L{level};" for level in range(levels))
    used = "".join(f"lookup L{level};" for level in range(levels))
    addOpenTypeFeaturesFromString(font, f"{lookups} feature ccmp {{ {used} }} ccmp;")
    stream = BytesIO()
    font.save(stream)
    return stream.getvalue()
