"""Text to closed polygons: glyph outlines flattened, united, cleaned and normalised to width 1."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from fontTools.pens.recordingPen import RecordingPen
from manifold3d import CrossSection, FillRule, JoinType, OpType

from core.arrays import Float
from core.artwork.artwork import Artwork, FaceUse
from core.artwork.layout import Block, set_text
from core.artwork.shaping import Glyph
from core.artwork.style import PLAIN, TextStyle
from core.artwork.typeface import Typeface, uploaded_face
from core.errors import ErrorCode, MeshmarkError
from core.geometry.triangles import ring_area
from core.parameters import Direction

MAX_POINTS = 20_000

# Share of the text's width, since long text is placed smaller; chord tolerance of flattened curves. In ems it is
# bounded above, so that no letter is visibly a polygon, and below by the visible error in a letter two hundred pixels
# high. Twice as much is visible there in "watermark", and saves a fifth of its triangles only.
WIDTH_TOLERANCE = 0.0008
EM_TOLERANCE = 0.0045, 0.01

# Shares of the text's width. Rings come no closer to each other or to themselves than CLEARANCE: rings that touch would
# be cut into a surface as a non-manifold seam.
CLEARANCE = 1e-4
MERGE_DISTANCE = 2e-5
MIN_AREA = 1e-7


def text_artwork(text: str, font: bytes | None = None, style: TextStyle = PLAIN) -> Artwork:
    """Outlines of ``text`` in ``font`` (the bytes of a TTF or OTF file) and, for what it lacks, the installed ones.

    Raises:
        MeshmarkError: ``empty_text``, ``missing_glyphs``, ``invalid_font``, or ``invalid_parameters`` for control
            characters, more than six lines, and outlines of more than 20,000 points.
    """
    block = set_text(text, style, None if font is None else uploaded_face(font))
    outlines, scale = _outlines(block)
    rings = [ring for ring in _united(outlines, text).to_polygons() if abs(ring_area(ring)) >= MIN_AREA]
    if not rings:
        raise MeshmarkError(
            ErrorCode.EMPTY_TEXT,
            f"The text {text!r} has no visible outline in this font.",
            "Send at least one visible character.",
        )
    _require_few_points(sum(map(len, rings)), text)
    points = np.concatenate(rings)
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = high - low
    one_row = len(block.lines) == 1 and style.direction is Direction.HORIZONTAL
    return Artwork(
        label=text,
        rings=tuple((ring - (low + high) / 2) / width for ring in rings),
        aspect=float(height / width),
        ink=sum(map(ring_area, rings)) / float(width * height),
        line_height=float(height / width) if one_row else block.line_height * scale / float(width),
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
    flat = {key: _flatten(segments, tolerance * key[0].upem) for key, segments in drawn.items()}
    return [
        _Outline(
            [_placed(contour, glyph, block.upem) / width for contour in flat[glyph.face, glyph.id]],
            glyph.face.offset * block.upem / width,
        )
        for glyph in block.glyphs
    ], 1 / float(width)


def _placed(points: Float, glyph: Glyph, upem: int) -> Float:
    """Points (N, 2) of a glyph where it stands in its text, in the text's units."""
    turned: Float = np.column_stack([points[:, 1], -points[:, 0]]) if glyph.sideways else points
    origin = np.array([glyph.x, glyph.y])
    placed: Float = turned * (upem / glyph.face.upem) + origin
    return placed


def _flatten(segments: list[tuple[str, tuple[tuple[float, float], ...]]], tolerance: float) -> list[Float]:
    """Pen segments as polygons whose chords stay within ``tolerance`` of the curves."""
    contours: list[Float] = []
    pieces: list[Float] = []
    for kind, points in segments:
        if kind == "moveTo":
            pieces = [np.array(points, dtype=np.float64)]
        elif kind == "closePath":
            contours.append(np.concatenate(pieces))
        else:
            pieces.append(_curve(np.vstack([pieces[-1][-1:], points]), tolerance))
    return [contour for contour in contours if len(contour) >= 3]


def _curve(control: Float, tolerance: float) -> Float:
    """Points of a Bezier curve of degree 1 to 3 after its start.

    Chords over equal parameter steps h lie within max|B''| h^2 / 8 of the curve, and |B''| is at most
    n (n - 1) times the largest second difference of the n + 1 control points.
    """
    degree = len(control) - 1
    bend = np.linalg.norm(np.diff(control, n=2, axis=0), axis=1).max(initial=0) if degree > 1 else 0
    steps = max(1, int(np.ceil(np.sqrt(degree * (degree - 1) * bend / (8 * tolerance)))))
    t = np.arange(1, steps + 1)[:, None] / steps
    layers = [np.broadcast_to(point, (steps, 2)) for point in control]
    while len(layers) > 1:  # de Casteljau
        layers = [(1 - t) * a + t * b for a, b in pairwise(layers)]
    return np.array(layers[0])


def _united(outlines: list[_Outline], text: str) -> CrossSection:
    """The union of all glyphs, each filled by the non-zero rule as both outline formats demand."""
    _require_few_points(sum(len(contour) for outline in outlines for contour in outline.contours), text)
    sections = [_filled(outline) for outline in outlines if outline.contours]
    union = CrossSection.batch_boolean(sections, OpType.Add).simplify(MERGE_DISTANCE)
    reach = [union.offset(sign * CLEARANCE / 2, JoinType.Miter) for sign in (-1, 1)]
    if any(_topology(section) != _topology(union) for section in reach):
        # Rings touch or nearly do: a morphological opening cuts hairline necks and widens hairline gaps.
        union = union.offset(-CLEARANCE, JoinType.Miter).offset(CLEARANCE / 2, JoinType.Miter)
        union = union.simplify(MERGE_DISTANCE)
    return union


def _filled(outline: _Outline) -> CrossSection:
    section = CrossSection(outline.contours, FillRule.NonZero)
    return section.offset(outline.offset, JoinType.Miter) if outline.offset else section


def _topology(section: CrossSection) -> tuple[int, int]:
    areas = [ring_area(ring) for ring in section.to_polygons()]
    return sum(area > MIN_AREA for area in areas), sum(area < -MIN_AREA for area in areas)


def _require_few_points(count: int, text: str) -> None:
    if count > MAX_POINTS:
        raise MeshmarkError(
            ErrorCode.INVALID_PARAMETERS,
            f"The outlines of {text!r} have {count:,} points; at most {MAX_POINTS:,} can be embossed.",
            "Send a shorter text or a font with plainer letters.",
        )
