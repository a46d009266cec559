"""Text to closed polygons: glyph outlines flattened, united, cleaned and normalised to width 1."""

from itertools import pairwise

import numpy as np
import uharfbuzz as hb
from fontTools.pens.recordingPen import RecordingPen
from manifold3d import CrossSection, FillRule, JoinType, OpType

from core.arrays import Float
from core.artwork.artwork import Artwork
from core.artwork.fonts import default_font, load_font
from core.artwork.shaping import Glyph, shape
from core.errors import ErrorCode, MeshmarkError
from core.geometry.triangles import ring_area

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


def text_artwork(text: str, font: bytes | None = None) -> Artwork:
    """Outlines of ``text`` in ``font`` (the bytes of a TTF or OTF file; the bundled DejaVu Sans Bold if ``None``).

    Raises:
        MeshmarkError: ``empty_text``, ``missing_glyphs``, ``invalid_font``, or ``invalid_parameters`` for control
            characters and for outlines of more than 20,000 points.
    """
    hb_font = default_font() if font is None else load_font(font)
    shape_of_text = _united(_outlines(shape(text, hb_font), hb_font), text)
    rings = [ring for ring in shape_of_text.to_polygons() if abs(ring_area(ring)) >= MIN_AREA]
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
    return Artwork(
        label=text,
        rings=tuple((ring - (low + high) / 2) / width for ring in rings),
        aspect=float(height / width),
        ink=sum(map(ring_area, rings)) / float(width * height),
        line_height=float(height / width),
    )


def _outlines(glyphs: list[Glyph], font: hb.Font) -> list[list[Float]]:
    """For each visible glyph its contours as (N, 2) polygons, scaled so that the text is about 1 wide."""
    drawn: dict[int, list[tuple[str, tuple[tuple[float, float], ...]]]] = {}
    for glyph in glyphs:
        if glyph.id not in drawn:
            pen = RecordingPen()
            font.draw_glyph_with_pen(glyph.id, pen)
            drawn[glyph.id] = pen.value
    reach = [glyph.x + point[0] for glyph in glyphs for _, points in drawn[glyph.id] for point in points]
    width = max(reach) - min(reach) if reach else 0
    if width <= 0:
        return []
    finest, coarsest = (share * font.face.upem for share in EM_TOLERANCE)
    tolerance = min(max(WIDTH_TOLERANCE * width, finest), coarsest)
    flat = {glyph_id: _flatten(segments, tolerance) for glyph_id, segments in drawn.items()}
    return [[(contour + np.array([glyph.x, glyph.y])) / width for contour in flat[glyph.id]] for glyph in glyphs]


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


def _united(glyphs: list[list[Float]], text: str) -> CrossSection:
    """The union of all glyphs, each filled by the non-zero rule as both outline formats demand."""
    _require_few_points(sum(len(contour) for contours in glyphs for contour in contours), text)
    sections = [CrossSection(contours, FillRule.NonZero) for contours in glyphs if contours]
    union = CrossSection.batch_boolean(sections, OpType.Add).simplify(MERGE_DISTANCE)
    reach = [union.offset(sign * CLEARANCE / 2, JoinType.Miter) for sign in (-1, 1)]
    if any(_topology(section) != _topology(union) for section in reach):
        # Rings touch or nearly do: a morphological opening cuts hairline necks and widens hairline gaps.
        union = union.offset(-CLEARANCE, JoinType.Miter).offset(CLEARANCE / 2, JoinType.Miter)
        union = union.simplify(MERGE_DISTANCE)
    return union


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
