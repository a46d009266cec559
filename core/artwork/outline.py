"""Text to closed polygons: glyph outlines flattened, united, cleaned and normalised to width 1."""

from dataclasses import dataclass

import numpy as np
from fontTools.pens.recordingPen import RecordingPen
from manifold3d import CrossSection, FillRule, JoinType, OpType

from core.arrays import Float
from core.artwork.artwork import Artwork, FaceUse
from core.artwork.layout import Block, set_text
from core.artwork.rings import clear_rings, flatten, normalised
from core.artwork.shaping import Glyph
from core.artwork.style import PLAIN, TextStyle
from core.artwork.typeface import Typeface, uploaded_face
from core.choices import Direction
from core.errors import ErrorCode, MeshmarkError

MAX_POINTS = 20_000

# Share of the text's width, since long text is placed smaller; chord tolerance of flattened curves. In ems it is
# bounded above, so that no letter is visibly a polygon, and below by the visible error in a letter two hundred pixels
# high. Twice as much is visible there in "watermark", and saves a fifth of its triangles only.
WIDTH_TOLERANCE = 0.0008
EM_TOLERANCE = 0.0045, 0.01


def text_artwork(text: str, font: bytes | None = None, style: TextStyle = PLAIN) -> Artwork:
    """Outlines of ``text`` in ``font`` (the bytes of a TTF or OTF file) and, for what it lacks, the installed ones.

    Raises:
        MeshmarkError: ``empty_text``, ``missing_glyphs``, ``invalid_font``, or ``invalid_parameters`` for control
            characters, more than six lines, and outlines of more than 20,000 points.
    """
    block = set_text(text, style, None if font is None else uploaded_face(font))
    outlines, scale = _outlines(block)
    rings = clear_rings(_united(outlines, text))
    if not rings:
        raise MeshmarkError(
            ErrorCode.EMPTY_TEXT,
            f"The text {text!r} has no visible outline in this font.",
            "Send at least one visible character.",
        )
    _require_few_points(sum(map(len, rings)), text)
    width = np.ptp(np.concatenate(rings)[:, 0])
    centred, aspect, ink = normalised(rings)
    one_row = len(block.lines) == 1 and style.direction is Direction.HORIZONTAL
    return Artwork(
        label=text,
        rings=centred,
        aspect=aspect,
        ink=ink,
        line_height=aspect if one_row else block.line_height * scale / float(width),
        lines=block.lines,
        faces=tuple(FaceUse(face.name, face.version, face.offset) for face in block.faces),
    )


@dataclass(frozen=True, eq=False)
class _Outline:
    """The contours of a glyph as (N, 2) polygons, and how far they are to be moved outwards."""

    contours: list[Float]
    offset: float


def _outlines(block: Block) -> tuple[list[_Outline], float]:
    """The outline of each glyph, scaled so that the text is about 1 wide, and the scale."""
    drawn: dict[tuple[Typeface, int], list[tuple[str, tuple[tuple[float, float], ...]]]] = {}
    for glyph in block.glyphs:
        if (glyph.face, glyph.id) not in drawn:
            pen = RecordingPen()
            glyph.face.font.draw_glyph_with_pen(glyph.id, pen)
            drawn[glyph.face, glyph.id] = pen.value
    reach = [
        _placed(np.array(points, dtype=np.float64), glyph, block.upem)[:, 0]
        for glyph in block.glyphs
        for _, points in drawn[glyph.face, glyph.id]
        if points
    ]
    width = max(map(np.max, reach)) - min(map(np.min, reach)) if reach else 0
    if width <= 0:
        return [], 1.0
    finest, coarsest = EM_TOLERANCE
    tolerance = min(max(WIDTH_TOLERANCE * width / block.upem, finest), coarsest)  # in ems
    flat = {key: flatten(segments, tolerance * key[0].upem) for key, segments in drawn.items()}
    return [
        _Outline(
            [_placed(contour, glyph, block.upem) / width for contour in flat[glyph.face, glyph.id]],
            glyph.face.offset * glyph.scale * block.upem / width,
        )
        for glyph in block.glyphs
    ], 1 / float(width)


def _placed(points: Float, glyph: Glyph, upem: int) -> Float:
    """Points (N, 2) of a glyph where it stands in its text, in the text's units."""
    turned: Float = np.column_stack([points[:, 1], -points[:, 0]]) if glyph.sideways else points
    origin = np.array([glyph.x, glyph.y])
    placed: Float = turned * (glyph.scale * upem / glyph.face.upem) + origin
    return placed


def _united(outlines: list[_Outline], text: str) -> CrossSection:
    """The union of all glyphs, each filled by the non-zero rule as both outline formats demand."""
    _require_few_points(sum(len(contour) for outline in outlines for contour in outline.contours), text)
    sections = [_filled(outline) for outline in outlines if outline.contours]
    return CrossSection.batch_boolean(sections, OpType.Add)


def _filled(outline: _Outline) -> CrossSection:
    section = CrossSection(outline.contours, FillRule.NonZero)
    return section.offset(outline.offset, JoinType.Miter) if outline.offset else section


def _require_few_points(count: int, text: str) -> None:
    if count > MAX_POINTS:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"The outlines of {text!r} have {count:,} points; at most {MAX_POINTS:,} can be embossed.",
            "Send a shorter text or a font with plainer letters.",
        )
